#include "tests/e2e/tcp_proxy.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <stdexcept>
#include <utility>

namespace tessera::e2e {
namespace {

constexpr int kLookMilliseconds = 5;
constexpr size_t kMaxWaitingBytes = 1 << 20;  // of one way; more are left to the sender

sockaddr_in Loopback(int port) {
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

const sockaddr* Plain(const sockaddr_in& address) { return reinterpret_cast<const sockaddr*>(&address); }

bool WouldWait() { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

// Closes with a reset, as of a peer that is gone.
void ResetSocket(int socket) {
  const linger at_once = {1, 0};
  ::setsockopt(socket, SOL_SOCKET, SO_LINGER, &at_once, sizeof(at_once));
  ::close(socket);
}

}  // namespace

TcpProxy::TcpProxy(const std::string& target) : target_port_(std::stoi(target.substr(target.rfind(':') + 1))) {
  listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  sockaddr_in bound = Loopback(0);
  socklen_t size = sizeof(bound);
  if (listener_ < 0 || ::bind(listener_, Plain(bound), size) != 0 || ::listen(listener_, 64) != 0 ||
      ::getsockname(listener_, reinterpret_cast<sockaddr*>(&bound), &size) != 0) {
    throw std::runtime_error("no port for a proxy");
  }
  address_ = "127.0.0.1:" + std::to_string(ntohs(bound.sin_port));
  thread_ = std::thread([this] { Run(); });
}

TcpProxy::~TcpProxy() {
  stop_ = true;
  thread_.join();
  for (const auto& connection : connections_) Reset(*connection);
  ::close(listener_);
}

void TcpProxy::Set(Mode mode) {
  mode_ = mode;
  for (const int64_t round = rounds_; rounds_ == round;) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

void TcpProxy::Reset(const Connection& connection) {
  ResetSocket(connection.there.from);
  ResetSocket(connection.back.from);
}

void TcpProxy::Run() {
  std::vector<pollfd> looked;
  while (!stop_) {
    ++rounds_;
    const Mode mode = mode_;
    if (drop_.exchange(false) || mode == Mode::kCut) {
      for (const auto& connection : connections_) Reset(*connection);
      connections_.clear();
    }
    looked.assign(1, {listener_, POLLIN, 0});
    const bool carries = mode == Mode::kPass || mode == Mode::kNoAnswers;
    if (carries) {
      for (const auto& connection : connections_) {
        for (const Way* way : {&connection->there, &connection->back}) {
          if (way == &connection->back && mode == Mode::kNoAnswers) continue;
          if (!way->ended && way->waiting_bytes < kMaxWaitingBytes) looked.push_back({way->from, POLLIN, 0});
        }
      }
    }
    ::poll(looked.data(), looked.size(), kLookMilliseconds);
    Accept();
    if (!carries) continue;
    std::erase_if(connections_, [&](const std::unique_ptr<Connection>& connection) {
      const bool lives = Carry(connection->there) && (mode == Mode::kNoAnswers || Carry(connection->back));
      const bool ended = connection->there.told && connection->back.told;
      if (!lives || ended) Reset(*connection);
      return !lives || ended;
    });
  }
}

void TcpProxy::Accept() {
  while (true) {
    const int near = ::accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (near < 0) return;
    ++accepted_;
    const int far = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const sockaddr_in target = Loopback(target_port_);
    if (mode_ == Mode::kCut || far < 0 || ::connect(far, Plain(target), sizeof(target)) != 0) {
      ++refused_;
      ResetSocket(near);
      if (far >= 0) ::close(far);
      continue;
    }
    ::fcntl(far, F_SETFL, ::fcntl(far, F_GETFL) | O_NONBLOCK);
    auto connection = std::make_unique<Connection>();
    connection->there.from = connection->back.to = near;
    connection->there.to = connection->back.from = far;
    connections_.push_back(std::move(connection));
  }
}

bool TcpProxy::Carry(Way& way) {
  const Time now = std::chrono::steady_clock::now();
  char bytes[1 << 16];
  while (!way.ended && way.waiting_bytes < kMaxWaitingBytes) {
    const ssize_t got = ::recv(way.from, bytes, sizeof(bytes), 0);
    if (got < 0 && WouldWait()) break;
    if (got < 0) return false;
    if (got == 0) {
      way.ended = true;
      break;
    }
    const auto delay = std::chrono::duration_cast<Time::duration>(std::chrono::duration<double>(delay_s_));
    way.chunks.push_back({now + delay, std::string(bytes, static_cast<size_t>(got))});
    way.waiting_bytes += static_cast<size_t>(got);
  }
  while (!way.chunks.empty() && way.chunks.front().due <= now) {
    std::string& chunk = way.chunks.front().bytes;
    const ssize_t sent = ::send(way.to, chunk.data(), chunk.size(), MSG_NOSIGNAL);
    if (sent < 0 && WouldWait()) return true;
    if (sent < 0) return false;
    way.waiting_bytes -= static_cast<size_t>(sent);
    chunk.erase(0, static_cast<size_t>(sent));
    if (chunk.empty()) way.chunks.pop_front();
  }
  if (way.ended && way.chunks.empty() && !way.told) {
    ::shutdown(way.to, SHUT_WR);
    way.told = true;
  }
  return true;
}

}  // namespace tessera::e2e
