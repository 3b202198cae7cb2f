// The bytes of image files.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"

namespace tessera {

// The whole file at `path`, or its first `size_bytes` bytes (fewer if it is shorter). INVALID_ARGUMENT with the path if
// the file does not exist, else the system's error.
StatusOr<std::vector<uint8_t>> ReadFileBytes(const std::string& path);
StatusOr<std::vector<uint8_t>> ReadFileStart(const std::string& path, int64_t size_bytes);

// Replaces the file at `path` atomically (WriteFileAtomic).
Status ReplaceFile(const std::string& path, const std::vector<uint8_t>& bytes);

// The samples of 1 or 3 (RGB) planes pixel by pixel, as JPEG and PNG files store them. INVALID_ARGUMENT for other
// images.
StatusOr<std::vector<uint8_t>> Interleaved(const ByteImage& image);

}  // namespace tessera
