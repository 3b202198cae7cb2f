// The socket of a service manager, as a unit of type notify gets it.
#pragma once

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdlib>
#include <string>

namespace tessera {

// Binds a socket in `folder`; NOTIFY_SOCKET names it as long as the object lives.
class NotifySocket {
 public:
  explicit NotifySocket(const std::string& folder) : fd_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)) {
    const std::string path = folder + "/notify";
    sockaddr_un address = {};
    address.sun_family = AF_UNIX;
    path.copy(address.sun_path, sizeof(address.sun_path) - 1);
    EXPECT_EQ(::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
    ::setenv("NOTIFY_SOCKET", path.c_str(), 1);
  }
  ~NotifySocket() {
    ::unsetenv("NOTIFY_SOCKET");
    ::close(fd_);
  }
  // The next message that has arrived; empty if there is none.
  std::string Received() const {
    char message[64] = {};
    const ssize_t size = ::recv(fd_, message, sizeof(message), 0);
    return std::string(message, size > 0 ? size : 0);
  }

 private:
  const int fd_;
};

}  // namespace tessera
