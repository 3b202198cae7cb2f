// Whole files of pixels in and out of memory.
#ifndef TESSERA_COMMON_IMAGING_FILE_BYTES_H_
#define TESSERA_COMMON_IMAGING_FILE_BYTES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// The whole file at `path`, or its first `size_bytes` bytes (fewer if it is shorter). INVALID_ARGUMENT naming the file
// if there is none, else the system's error.
StatusOr<std::vector<uint8_t>> ReadFileBytes(const std::string& path);
StatusOr<std::vector<uint8_t>> ReadFileStart(const std::string& path, int64_t size_bytes);

// Replaces the file at `path` by `bytes`, as a whole or not at all (WriteFileAtomic).
Status ReplaceFile(const std::string& path, const std::vector<uint8_t>& bytes);

}  // namespace tessera

#endif  // TESSERA_COMMON_IMAGING_FILE_BYTES_H_
