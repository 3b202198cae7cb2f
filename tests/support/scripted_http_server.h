// An HTTP server on loopback that gives the answers of a test, among them those that no good server gives.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace tessera {

struct ScriptedRequest {
  std::string method, target;                  // target: path and query
  std::map<std::string, std::string> headers;  // names in lower case
  std::string body;
};

struct ScriptedAnswer {
  int status = 200;
  std::map<std::string, std::string> headers;
  std::string body;
  int64_t declared_bytes = -1;  // Content-Length; -1: the body's, -2: none
  int64_t cut_after = -1;       // closes the connection after these bytes of the body
  bool silent = false;          // sends nothing more after cut_after bytes, but keeps the connection
};

class ScriptedHttpServer {
 public:
  using Handler = std::function<ScriptedAnswer(const ScriptedRequest&)>;

  explicit ScriptedHttpServer(Handler handler) : handler_(std::move(handler)) {
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    ::bind(listener_, reinterpret_cast<sockaddr*>(&address), size);
    ::listen(listener_, 64);
    ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    acceptor_ = std::thread([this] {
      for (int fd = 0; (fd = ::accept(listener_, nullptr, nullptr)) >= 0;) {
        const std::lock_guard lock(mutex_);
        connections_.push_back(fd);
        threads_.emplace_back([this, fd] { Serve(fd); });
      }
    });
  }
  ~ScriptedHttpServer() {
    ::shutdown(listener_, SHUT_RDWR);
    acceptor_.join();
    for (const int fd : connections_) ::shutdown(fd, SHUT_RDWR);
    for (std::thread& thread : threads_) thread.join();
    for (const int fd : connections_) ::close(fd);
    ::close(listener_);
  }

  std::string url() const { return "http://127.0.0.1:" + std::to_string(port_); }
  std::vector<ScriptedRequest> requests() const {
    const std::lock_guard lock(mutex_);
    return requests_;
  }
  size_t connections() const {
    const std::lock_guard lock(mutex_);
    return connections_.size();
  }

 private:
  static bool SendAll(int fd, const std::string& bytes) {
    for (size_t sent = 0; sent < bytes.size();) {
      const ssize_t n = ::send(fd, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
      if (n <= 0) return false;
      sent += static_cast<size_t>(n);
    }
    return true;
  }

  void Serve(int fd) {
    std::string buffer;
    const auto read_more = [&] {
      char bytes[65536];
      const ssize_t n = ::read(fd, bytes, sizeof(bytes));
      if (n > 0) buffer.append(bytes, static_cast<size_t>(n));
      return n > 0;
    };
    while (true) {
      size_t end = 0;
      while ((end = buffer.find("\r\n\r\n")) == std::string::npos) {
        if (!read_more()) return;
      }
      ScriptedRequest request;
      size_t line = buffer.find("\r\n");
      const std::string first = buffer.substr(0, line);
      request.method = first.substr(0, first.find(' '));
      request.target = first.substr(request.method.size() + 1, first.rfind(' ') - request.method.size() - 1);
      while (line < end) {
        const size_t begin = line + 2;
        line = buffer.find("\r\n", begin);
        const std::string header = buffer.substr(begin, line - begin);
        const size_t colon = header.find(':');
        std::string name = header.substr(0, colon);
        for (char& c : name) c = static_cast<char>(std::tolower(c));
        request.headers[name] = header.substr(std::min(header.size(), header.find_first_not_of(' ', colon + 1)));
      }
      if (request.headers.contains("expect")) SendAll(fd, "HTTP/1.1 100 Continue\r\n\r\n");
      const size_t size =
          request.headers.contains("content-length") ? std::stoul(request.headers["content-length"]) : 0;
      while (buffer.size() < end + 4 + size) {
        if (!read_more()) return;
      }
      request.body = buffer.substr(end + 4, size);
      buffer.erase(0, end + 4 + size);
      {
        const std::lock_guard lock(mutex_);
        requests_.push_back(request);
      }
      const ScriptedAnswer answer = handler_(request);
      std::string head = "HTTP/1.1 " + std::to_string(answer.status) + " Reason\r\n";
      for (const auto& [name, value] : answer.headers) head += name + ": " + value + "\r\n";
      if (answer.declared_bytes != -2 && !answer.headers.contains("Content-Length")) {
        const auto body_bytes = static_cast<int64_t>(answer.body.size());
        head += "Content-Length: " + std::to_string(answer.declared_bytes < 0 ? body_bytes : answer.declared_bytes) +
                "\r\n";
      }
      const std::string body = request.method == "HEAD" ? "" : answer.body;
      if (!SendAll(fd, head + "\r\n")) return;
      if (!SendAll(fd, answer.cut_after >= 0 ? body.substr(0, static_cast<size_t>(answer.cut_after)) : body)) return;
      if (answer.silent) continue;  // waits for a request that does not come
      if (answer.cut_after >= 0 || answer.declared_bytes != -1) {
        ::shutdown(fd, SHUT_RDWR);
        return;
      }
    }
  }

  const Handler handler_;
  int listener_ = -1;
  int port_ = 0;
  mutable std::mutex mutex_;
  std::vector<ScriptedRequest> requests_;
  std::vector<int> connections_;
  std::vector<std::thread> threads_;
  std::thread acceptor_;
};

}  // namespace tessera
