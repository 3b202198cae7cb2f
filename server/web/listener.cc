#include "server/web/listener.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

constexpr int kBacklog = 512;

int PortOf(int socket) {
  sockaddr_storage bound = {};
  socklen_t size = sizeof(bound);
  if (::getsockname(socket, reinterpret_cast<sockaddr*>(&bound), &size) != 0) return 0;
  return ntohs(bound.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6&>(bound).sin6_port
                                           : reinterpret_cast<const sockaddr_in&>(bound).sin_port);
}

void SetPort(sockaddr* address, int port) {
  if (address->sa_family == AF_INET6) {
    reinterpret_cast<sockaddr_in6*>(address)->sin6_port = htons(static_cast<uint16_t>(port));
  } else {
    reinterpret_cast<sockaddr_in*>(address)->sin_port = htons(static_cast<uint16_t>(port));
  }
}

// -1 if it fails.
int ListenOn(const addrinfo& place) {
  const int fd = ::socket(place.ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0) return -1;
  const int on = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  if (place.ai_family == AF_INET6) ::setsockopt(fd, IPPROTO_IPV6, IPV6_V6ONLY, &on, sizeof(on));
  if (::bind(fd, place.ai_addr, place.ai_addrlen) == 0 && ::listen(fd, kBacklog) == 0) return fd;
  ::close(fd);
  return -1;
}

}  // namespace

Listener::Listener(Listener&& other) noexcept
    : sockets_(std::exchange(other.sockets_, {})), address_(std::move(other.address_)) {}

Listener::~Listener() {
  for (const int fd : sockets_) ::close(fd);
}

StatusOr<Listener> Listener::Open(const std::string& address) {
  const size_t colon = address.rfind(':');
  std::string host = address.substr(0, colon), port = address.substr(colon + 1);
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  addrinfo hints = {};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
  addrinfo* found = nullptr;
  const int failed = ::getaddrinfo(host.c_str(), port.c_str(), &hints, &found);
  if (failed != 0)
    return absl::UnavailableError(absl::StrCat("cannot listen on ", address, ": ", ::gai_strerror(failed)));
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> places(found, &::freeaddrinfo);
  Listener listener;
  int bound = 0;
  std::string error = "no address";
  for (const addrinfo* place = found; place != nullptr; place = place->ai_next) {
    if (place->ai_family != AF_INET && place->ai_family != AF_INET6) continue;
    if (bound > 0) SetPort(place->ai_addr, bound);  // all share the port
    const int fd = ListenOn(*place);
    if (fd < 0) {
      error = std::strerror(errno);
      // A machine may have a name for an address of a family that it does not have.
      if (errno == EADDRNOTAVAIL || errno == EAFNOSUPPORT) continue;
      return absl::UnavailableError(absl::StrCat("cannot listen on ", address, ": ", error));
    }
    listener.sockets_.push_back(fd);
    if (bound == 0) bound = PortOf(fd);
  }
  if (listener.sockets_.empty()) return absl::UnavailableError(absl::StrCat("cannot listen on ", address, ": ", error));
  listener.address_ = absl::StrCat(address.substr(0, colon + 1), bound);
  return listener;
}

Listener::Accepted Listener::Accept(int socket) {
  sockaddr_storage from = {};
  socklen_t size = sizeof(from);
  Accepted accepted;
  accepted.fd = ::accept4(socket, reinterpret_cast<sockaddr*>(&from), &size, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (accepted.fd < 0) return accepted;
  const int on = 1;
  ::setsockopt(accepted.fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  char text[INET6_ADDRSTRLEN] = "";
  if (from.ss_family == AF_INET6) {
    const auto& ip = reinterpret_cast<const sockaddr_in6&>(from);
    ::inet_ntop(AF_INET6, &ip.sin6_addr, text, sizeof(text));
    accepted.peer = absl::StrCat("ipv6:[", text, "]:", ntohs(ip.sin6_port));
  } else {
    const auto& ip = reinterpret_cast<const sockaddr_in&>(from);
    ::inet_ntop(AF_INET, &ip.sin_addr, text, sizeof(text));
    accepted.peer = absl::StrCat("ipv4:", text, ":", ntohs(ip.sin_port));
  }
  accepted.host = text;
  return accepted;
}

std::string AddressKey(const std::string& host) {
  in6_addr ip = {};
  if (::inet_pton(AF_INET6, host.c_str(), &ip) != 1) return host;
  std::fill(ip.s6_addr + 8, ip.s6_addr + 16, uint8_t{0});
  char text[INET6_ADDRSTRLEN] = "";
  ::inet_ntop(AF_INET6, &ip, text, sizeof(text));
  return absl::StrCat(text, "/64");
}

}  // namespace tessera
