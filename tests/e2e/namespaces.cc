#include "tests/e2e/namespaces.h"

#include <net/if.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/mount.h>
#include <sys/socket.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <stdexcept>

#include "common/storage/files.h"

namespace tessera::e2e {
namespace {

Status NotPermitted(const std::string& what) {
  return absl::FailedPreconditionError(what + " is not permitted here: " + std::strerror(errno));
}

bool Write(const std::string& path, const std::string& content) {
  std::ofstream file(path);
  file << content;
  file.close();
  return !file.fail();
}

Status StartLoopback() {
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  ifreq request = {};
  std::strncpy(request.ifr_name, "lo", IFNAMSIZ - 1);
  request.ifr_flags = IFF_UP | IFF_RUNNING;
  const bool up = socket >= 0 && ::ioctl(socket, SIOCSIFFLAGS, &request) == 0;
  const Status status = up ? absl::OkStatus() : NotPermitted("a loopback of one's own");
  if (socket >= 0) ::close(socket);
  return status;
}

int64_t Room(const std::string& folder, bool used) {
  struct statvfs info = {};
  if (::statvfs(folder.c_str(), &info) != 0) return 0;
  return static_cast<int64_t>((used ? info.f_blocks - info.f_bfree : info.f_blocks) * info.f_frsize);
}

bool Resize(const std::string& folder, int64_t bytes) {
  return ::mount("none", folder.c_str(), "tmpfs", MS_REMOUNT, ("size=" + std::to_string(bytes)).c_str()) == 0;
}

}  // namespace

Status EnterNamespaces(int kinds) {
  const std::string user = std::to_string(::geteuid()), group = std::to_string(::getegid());
  if (::unshare(kinds) != 0) {
    if (::unshare(kinds | CLONE_NEWUSER) != 0) return NotPermitted("a namespace of one's own");
    if (!Write("/proc/self/setgroups", "deny") || !Write("/proc/self/uid_map", "0 " + user + " 1") ||
        !Write("/proc/self/gid_map", "0 " + group + " 1")) {
      return NotPermitted("being root of a user namespace");
    }
  }
  // What is mounted here is not to be seen outside.
  if ((kinds & CLONE_NEWNS) != 0 && ::mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0) {
    return NotPermitted("to keep mounts to oneself");
  }
  return (kinds & CLONE_NEWNET) != 0 ? StartLoopback() : absl::OkStatus();
}

Status MountMemory(const std::string& folder, int64_t bytes) {
  TESSERA_RETURN_IF_ERROR(EnsureFolder(folder));
  if (::mount("none", folder.c_str(), "tmpfs", 0, ("size=" + std::to_string(bytes)).c_str()) == 0) {
    return absl::OkStatus();
  }
  return NotPermitted("a mount");
}

Status Unmount(const std::string& folder) {
  return ::umount2(folder.c_str(), MNT_DETACH) == 0 ? absl::OkStatus() : NotPermitted("unmounting " + folder);
}

FullDisk::FullDisk(const std::string& folder) : folder_(folder), bytes_(Room(folder, false)) {
  constexpr int kTries = 100;  // somebody may write meanwhile
  for (int i = 0; i < kTries; ++i) {
    if (Resize(folder_, Room(folder_, true))) return;
  }
  throw std::runtime_error(folder + " cannot be made as small as what is in it: " + std::strerror(errno));
}

FullDisk::~FullDisk() { Resize(folder_, bytes_); }

}  // namespace tessera::e2e
