// Reading and writing of whole image files.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// The whole file at `path`, or its first `size_bytes` bytes (fewer if it is shorter). INVALID_ARGUMENT with the path if
// the file does not exist, else the system's error.
StatusOr<std::vector<uint8_t>> ReadFileBytes(const std::string& path);
StatusOr<std::vector<uint8_t>> ReadFileStart(const std::string& path, int64_t size_bytes);

// Replaces the file at `path` atomically (WriteFileAtomic).
Status ReplaceFile(const std::string& path, const std::vector<uint8_t>& bytes);

}  // namespace tessera
