// Ports for servers that a test stops and starts again.
#pragma once

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <random>
#include <stdexcept>
#include <string>

namespace tessera::e2e {

// HOST:PORT with a free port below those that the system gives to other programs: one of them could take the port while
// its server is away.
inline std::string FreeAddress(const std::string& host = "127.0.0.1") {
  std::random_device random;
  for (int i = 0; i < 100; ++i) {
    const int port = 10000 + static_cast<int>(random() % 20000);
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in name = {};
    name.sin_family = AF_INET;
    name.sin_port = htons(static_cast<uint16_t>(port));
    const bool free = ::bind(fd, reinterpret_cast<sockaddr*>(&name), sizeof(name)) == 0;
    ::close(fd);
    if (free) return host + ":" + std::to_string(port);
  }
  throw std::runtime_error("no free port");
}

}  // namespace tessera::e2e
