// Whole files of pixels in and out of memory.
#ifndef TESSERA_COMMON_IMAGING_FILE_BYTES_H_
#define TESSERA_COMMON_IMAGING_FILE_BYTES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// The bytes of the file at `path`; `limit_bytes` bounds how many from its start. INVALID_ARGUMENT naming the file if it
// cannot be read.
StatusOr<std::vector<uint8_t>> ReadFileBytes(const std::string& path, int64_t limit_bytes = INT64_MAX);

// Replaces the file at `path` by `bytes`: written to a temporary name beside it, synced, renamed, the folder synced.
// After an error the old file is as it was.
Status ReplaceFile(const std::string& path, const std::vector<uint8_t>& bytes);

}  // namespace tessera

#endif  // TESSERA_COMMON_IMAGING_FILE_BYTES_H_
