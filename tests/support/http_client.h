// A client of HTTP/1.1 that sends exactly what a test says.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tessera {

struct HttpReply {
  int status = 0;                                   // 0: none came
  std::multimap<std::string, std::string> headers;  // by lower-case names
  std::string body;
  std::string Header(const std::string& name) const {
    const auto found = headers.find(name);
    return found == headers.end() ? "" : found->second;
  }
};

using SentHeaders = std::vector<std::pair<std::string, std::string>>;

// One connection to a server on loopback.
class HttpConnection {
 public:
  // `address`: HOST:PORT, of which the port counts.
  explicit HttpConnection(const std::string& address) : host_(address) {
    fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in to = {};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<uint16_t>(std::stoi(address.substr(address.rfind(':') + 1))));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = ::connect(fd_, reinterpret_cast<const sockaddr*>(&to), sizeof(to)) == 0;
  }
  ~HttpConnection() { ::close(fd_); }
  HttpConnection(const HttpConnection&) = delete;
  HttpConnection& operator=(const HttpConnection&) = delete;

  bool connected() const { return connected_; }
  int fd() const { return fd_; }
  // False when the server has closed the connection.
  bool Send(std::string_view bytes) {
    while (!bytes.empty()) {
      const ssize_t n = ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (n <= 0) return false;
      bytes.remove_prefix(static_cast<size_t>(n));
    }
    return true;
  }
  // Waits for more bytes; false at the end of the connection or after `ms`.
  bool Receive(int ms = 20'000) {
    pollfd state = {fd_, POLLIN, 0};
    char bytes[16 << 10];
    if (::poll(&state, 1, ms) <= 0) return false;
    const ssize_t n = ::recv(fd_, bytes, sizeof(bytes), 0);
    if (n <= 0) return false;
    received_.append(bytes, static_cast<size_t>(n));
    return true;
  }
  // Whether the server closes the connection within `ms`.
  bool Ends(int ms) {
    pollfd state = {fd_, POLLIN, 0};
    char bytes[16 << 10];
    while (::poll(&state, 1, ms) > 0) {
      if (::recv(fd_, bytes, sizeof(bytes), 0) <= 0) return true;
    }
    return false;
  }
  static std::string Text(const std::string& method, const std::string& target, const SentHeaders& headers,
                          const std::string& body, const std::string& host) {
    std::string text = method + " " + target + " HTTP/1.1\r\n";
    const bool has_host = std::any_of(headers.begin(), headers.end(), [](const auto& h) { return h.first == "Host"; });
    if (!has_host) text += "Host: " + host + "\r\n";
    for (const auto& [name, value] : headers) text += name + ": " + value + "\r\n";
    if (!body.empty() || method == "POST" || method == "PATCH") {
      text += "Content-Length: " + std::to_string(body.size()) + "\r\n";
    }
    return text + "\r\n" + body;
  }
  HttpReply Ask(const std::string& method, const std::string& target, const SentHeaders& headers = {},
                const std::string& body = "") {
    Send(Text(method, target, headers, body, host_));
    return Answer(method == "HEAD");
  }
  // The head of the next answer; its body stays in received().
  HttpReply Head() {
    HttpReply answer;
    size_t end = 0;
    while ((end = received_.find("\r\n\r\n")) == std::string::npos) {
      if (!Receive()) return answer;
    }
    const std::string head = received_.substr(0, end + 2);
    received_.erase(0, end + 4);
    answer.status = std::atoi(head.c_str() + head.find(' ') + 1);
    for (size_t at = head.find("\r\n") + 2; at < head.size();) {
      const size_t line_end = head.find("\r\n", at), colon = head.find(':', at);
      std::string name = head.substr(at, colon - at);
      std::transform(name.begin(), name.end(), name.begin(), ::tolower);
      answer.headers.emplace(name, head.substr(colon + 2, line_end - colon - 2));
      at = line_end + 2;
    }
    return answer;
  }
  HttpReply Answer(bool is_head = false) {
    HttpReply answer = Head();
    if (answer.status == 0 || is_head || answer.status == 304) return answer;
    if (answer.Header("transfer-encoding") == "chunked") {
      while (true) {
        size_t line = 0;
        while ((line = received_.find("\r\n")) == std::string::npos) {
          if (!Receive()) return answer;
        }
        const size_t size = std::strtoul(received_.c_str(), nullptr, 16);
        while (received_.size() < line + 2 + size + 2) {
          if (!Receive()) return answer;
        }
        answer.body += received_.substr(line + 2, size);
        received_.erase(0, line + 2 + size + 2);
        if (size == 0) return answer;
      }
    }
    const size_t size = std::strtoul(answer.Header("content-length").c_str(), nullptr, 10);
    while (received_.size() < size) {
      if (!Receive()) break;
    }
    answer.body = received_.substr(0, size);
    received_.erase(0, size);
    return answer;
  }
  std::string& received() { return received_; }

 private:
  const std::string host_;
  int fd_ = -1;
  bool connected_ = false;
  std::string received_;
};

inline HttpReply HttpAsk(const std::string& address, const std::string& method, const std::string& target,
                         const SentHeaders& headers = {}, const std::string& body = "") {
  return HttpConnection(address).Ask(method, target, headers, body);
}

}  // namespace tessera
