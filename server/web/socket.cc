#include "server/web/socket.h"

#include <openssl/err.h>
#include <openssl/ssl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

namespace tessera {
namespace {

constexpr size_t kReadBytes = 16 << 10;

bool MayRepeat() { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

}  // namespace

Socket::Socket(int fd, std::shared_ptr<ssl_ctx_st> tls) : fd_(fd), tls_(std::move(tls)) {
  if (tls_ == nullptr) return;
  ssl_ = SSL_new(tls_.get());
  if (ssl_ == nullptr) return;
  SSL_set_fd(ssl_, fd_);
  SSL_set_accept_state(ssl_);
}

Socket::~Socket() {
  if (ssl_ != nullptr) SSL_free(ssl_);
  ERR_clear_error();
  ::close(fd_);
}

Socket::Result Socket::ResultOf(int returned) const {
  const int error = SSL_get_error(ssl_, returned);
  ERR_clear_error();
  if (error == SSL_ERROR_WANT_READ) return Result::kWantsRead;
  if (error == SSL_ERROR_WANT_WRITE) return Result::kWantsWrite;
  return Result::kClosed;
}

Socket::Result Socket::Handshake() {
  if (tls_ == nullptr) return Result::kDone;
  if (ssl_ == nullptr) return Result::kClosed;
  ERR_clear_error();
  const int returned = SSL_do_handshake(ssl_);
  return returned == 1 ? Result::kDone : ResultOf(returned);
}

Socket::Result Socket::Read(size_t max_bytes, std::string* bytes) {
  char buffer[kReadBytes];
  const size_t size = std::min(max_bytes, sizeof(buffer));
  if (ssl_ != nullptr) {
    ERR_clear_error();
    const int n = SSL_read(ssl_, buffer, static_cast<int>(size));
    if (n <= 0) return ResultOf(n);
    bytes->append(buffer, static_cast<size_t>(n));
    return Result::kDone;
  }
  const ssize_t n = ::recv(fd_, buffer, size, 0);
  if (n < 0) return MayRepeat() ? Result::kWantsRead : Result::kClosed;
  if (n == 0) return Result::kClosed;
  bytes->append(buffer, static_cast<size_t>(n));
  return Result::kDone;
}

Socket::Result Socket::Write(std::string_view* bytes) {
  while (!bytes->empty()) {
    size_t sent = 0;
    if (ssl_ != nullptr) {
      ERR_clear_error();
      const int n = SSL_write(ssl_, bytes->data(), static_cast<int>(std::min<size_t>(bytes->size(), 1 << 20)));
      if (n <= 0) return ResultOf(n);
      sent = static_cast<size_t>(n);
    } else {
      const ssize_t n = ::send(fd_, bytes->data(), bytes->size(), MSG_NOSIGNAL);
      if (n < 0) return MayRepeat() ? Result::kWantsWrite : Result::kClosed;
      sent = static_cast<size_t>(n);
    }
    bytes->remove_prefix(sent);
  }
  return Result::kDone;
}

bool Socket::ClosedByPeer() const {
  pollfd state = {fd_, POLLRDHUP, 0};
  return ::poll(&state, 1, 0) > 0 && (state.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0;
}

void Socket::EndWriting() {
  if (ssl_ != nullptr) SSL_shutdown(ssl_);
  ERR_clear_error();
  ::shutdown(fd_, SHUT_WR);
}

void Socket::Abort() {
  const linger at_once = {1, 0};
  ::setsockopt(fd_, SOL_SOCKET, SO_LINGER, &at_once, sizeof(at_once));
}

}  // namespace tessera
