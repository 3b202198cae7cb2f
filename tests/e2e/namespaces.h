// Mounts and networks that a test may spoil: namespaces of its process and of all programs that it starts.
#ifndef TESSERA_TESTS_E2E_NAMESPACES_H_
#define TESSERA_TESTS_E2E_NAMESPACES_H_

#include <cstdint>
#include <string>

#include "common/base/status.h"

namespace tessera::e2e {

// Gives this process, and what it starts from now on, mounts (CLONE_NEWNS) or a network (CLONE_NEWNET, loopback alone)
// of their own; who is not root becomes it, in a user namespace. All of it is gone with the last of the processes.
// FAILED_PRECONDITION with the reason where that is not permitted; without root it never is once there are threads.
Status EnterNamespaces(int kinds);

// Makes the folder, and an empty file system in memory on it. Needs mounts of one's own.
Status MountMemory(const std::string& folder, int64_t bytes);
Status Unmount(const std::string& folder);

// As long as it lives, a file system of MountMemory is full: no larger than what is in it. Throws std::runtime_error
// if that cannot be.
class FullDisk {
 public:
  explicit FullDisk(const std::string& folder);
  ~FullDisk();
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  const std::string folder_;
  int64_t bytes_ = 0;  // that it had room for
};

}  // namespace tessera::e2e

#endif  // TESSERA_TESTS_E2E_NAMESPACES_H_
