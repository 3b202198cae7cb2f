#include "tests/e2e/coordinator_pair.h"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>
#include <utility>

namespace tessera::e2e {
namespace {

// Free ports of loopback. The coordinators bind them later, because clients know both addresses from the start.
std::array<std::string, 2> FreeAddresses() {
  std::array<std::string, 2> addresses;
  std::array<int, 2> sockets = {};
  for (int i = 0; i < 2; ++i) {
    sockets[i] = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in name = {};
    name.sin_family = AF_INET;
    name.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(name);
    if (::bind(sockets[i], reinterpret_cast<sockaddr*>(&name), sizeof(name)) != 0 ||
        ::getsockname(sockets[i], reinterpret_cast<sockaddr*>(&name), &size) != 0) {
      throw std::runtime_error("no free port");
    }
    addresses[i] = "127.0.0.1:" + std::to_string(ntohs(name.sin_port));
  }
  for (const int fd : sockets) ::close(fd);
  return addresses;
}

}  // namespace

CoordinatorPair::CoordinatorPair(const std::string& folder, const std::string& state,
                                 std::vector<std::string> arguments)
    : folder_(folder), state_(state), arguments_(std::move(arguments)), addresses_(FreeAddresses()) {}

Program& CoordinatorPair::Start(int which, const std::string& state, const std::vector<std::string>& arguments) {
  std::filesystem::remove(PortFile(which));
  std::vector<std::string> all = arguments_;
  all.insert(all.end(), arguments.begin(), arguments.end());
  const bool own_blobs = std::find(all.begin(), all.end(), "--blobs") != all.end();
  if (!own_blobs) all.insert(all.end(), {"--blobs", blobs()});
  all.insert(all.end(),
             {"--state", state.empty() ? state_ : state, "--data", folder_ + "/data-" + std::to_string(which),
              "--listen", addresses_[which], "--port-file", PortFile(which), "--lease-s", "3"});
  programs_[which] = nullptr;
  programs_[which] = std::make_unique<Program>(folder_, TESSERAD_PROGRAM, all);
  return *programs_[which];
}

bool CoordinatorPair::IsActive(int which) const { return std::filesystem::exists(PortFile(which)); }

bool CoordinatorPair::AwaitActive(int which) {
  WaitUntil([&] { return IsActive(which) || !programs_[which]->Running(); });
  return programs_[which]->Running();
}

bool CoordinatorPair::AwaitStandby(int which) {
  WaitUntil([&] {
    return programs_[which]->Output().find("coordinator stands by") != std::string::npos ||
           !programs_[which]->Running();
  });
  return programs_[which]->Running();
}

}  // namespace tessera::e2e
