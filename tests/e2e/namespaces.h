// Mount and network namespaces for a test process and the programs that it starts.
#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"

namespace tessera::e2e {

// Moves this process to a new mount namespace (CLONE_NEWNS) or network namespace (CLONE_NEWNET, loopback only); child
// processes inherit it. Without root, also enters a user namespace as root. The namespace ends with its last process.
// FAILED_PRECONDITION with the reason if not permitted; without root that includes any process with threads.
Status EnterNamespaces(int kinds);

// Creates the folder and mounts an empty tmpfs on it. Needs a mount namespace.
Status MountMemory(const std::string& folder, int64_t bytes);
Status Unmount(const std::string& folder);

// While it exists, a file system of MountMemory is full: its size is reduced to its content. Throws std::runtime_error
// on failure.
class FullDisk {
 public:
  explicit FullDisk(const std::string& folder);
  ~FullDisk();
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  const std::string folder_;
  int64_t bytes_ = 0;  // original size
};

}  // namespace tessera::e2e
