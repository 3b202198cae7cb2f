// A connection's socket, with or without TLS. Nothing blocks.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

struct ssl_ctx_st;
struct ssl_st;

namespace tessera {

// Not thread-safe.
class Socket {
 public:
  enum class Result { kDone, kWantsRead, kWantsWrite, kClosed };

  // Owns `fd`, which does not block. `tls`: null without TLS.
  Socket(int fd, std::shared_ptr<ssl_ctx_st> tls);
  ~Socket();
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;

  int fd() const { return fd_; }
  // Call until kDone before anything else.
  Result Handshake();
  // Appends at most `max_bytes` to *bytes.
  Result Read(size_t max_bytes, std::string* bytes);
  // Removes from *bytes what was sent; kDone when it is empty.
  Result Write(std::string_view* bytes);
  // Whether the other end has closed the connection.
  bool ClosedByPeer() const;
  // Tells the other end that no more bytes follow, so that it reads what was sent.
  void EndWriting();
  // What was written but not received yet is dropped when the socket is closed.
  void Abort();

 private:
  Result ResultOf(int returned) const;

  const int fd_;
  const std::shared_ptr<ssl_ctx_st> tls_;
  ssl_st* ssl_ = nullptr;  // null without TLS
};

}  // namespace tessera
