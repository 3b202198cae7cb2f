// Decoding of JPEG images. Uses libjpeg-turbo itself, because OpenCV hides the damage that libjpeg reports.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Rows of interleaved blue, green, red samples.
struct BgrRows {
  uint8_t* data = nullptr;
  size_t stride_bytes = 0;
  int width = 0, height = 0;
};

// Decodes `bytes`, the content of the file at `path`, into `rows`; the same bits as OpenCV's decoder. False for an
// image of four components (CMYK): it was checked, but not decoded. INVALID_ARGUMENT for an image of another size, and
// for a truncated or damaged image. libjpeg fills missing parts with grey and repairs others by guessing; both count as
// damage. Padding of equal bytes between the image data and a marker does not: some cameras write it. A change of a few
// bits may pass, if the data still add up.
StatusOr<bool> DecodeJpeg(const std::string& path, const std::vector<uint8_t>& bytes, const BgrRows& rows);

}  // namespace tessera
