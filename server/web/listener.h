// Sockets that accept TCP connections.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Closes its sockets. Not thread-safe.
class Listener {
 public:
  // `address`: HOST:PORT; port 0: any free one. Listens on all addresses of the host. UNAVAILABLE if that fails.
  static StatusOr<Listener> Open(const std::string& address);
  Listener(Listener&& other) noexcept;
  Listener& operator=(Listener&&) = delete;
  ~Listener();

  struct Accepted {
    int fd = -1;       // does not block; -1: none waits
    std::string host;  // the other end's address
    std::string peer;  // as gRPC writes it: ipv4:127.0.0.1:5000
  };
  // Does not block. Owned by the caller.
  static Accepted Accept(int socket);

  const std::vector<int>& sockets() const { return sockets_; }
  const std::string& address() const { return address_; }

 private:
  Listener() = default;
  std::vector<int> sockets_;
  std::string address_;
};

// The key by which callers of an address are counted: an IPv6 network of 64 bits is one. `host`: an address.
std::string AddressKey(const std::string& host);

}  // namespace tessera
