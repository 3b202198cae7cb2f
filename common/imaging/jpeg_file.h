// JPEG files. Uses libjpeg-turbo; OpenCV's codecs hide the damage that libjpeg reports, and bring GDAL into every
// program.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"

namespace tessera {

// Rows of interleaved blue, green, red samples.
struct BgrRows {
  uint8_t* data = nullptr;
  size_t stride_bytes = 0;
  int width = 0, height = 0;
};

// Decodes `bytes`, the content of the file at `path`, into `rows`; the same bits as OpenCV's decoder, also of CMYK.
// INVALID_ARGUMENT for an image of another size, and for a truncated or damaged image. libjpeg fills missing parts with
// grey and repairs others by guessing; both count as damage. Padding of equal bytes between the image data and a marker
// does not: some cameras write it. A change of a few bits may pass, if the data still add up.
Status DecodeJpeg(const std::string& path, const std::vector<uint8_t>& bytes, const BgrRows& rows);

// The content of a JPEG file of 1 or 3 (RGB) planes; `quality`: 1 to 100. INVALID_ARGUMENT for other images.
StatusOr<std::vector<uint8_t>> EncodeJpeg(const ByteImage& image, int quality);

}  // namespace tessera
