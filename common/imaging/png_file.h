// PNG files. Uses libpng; OpenCV prints its messages on the terminal.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"

namespace cv {
class Mat;
}

namespace tessera {

// Decodes the PNG image in `bytes`, the content of the file at `path`, to 8 or 16 bits and 1 (grey), 3 (BGR) or 4
// (BGRA) channels: palettes become colours, fewer than 8 bits become 8, grey with alpha and transparent colours become
// BGRA. INVALID_ARGUMENT for a damaged image. The caller has checked the size in the header.
Status DecodePng(const std::string& path, const std::vector<uint8_t>& bytes, cv::Mat* image);

// The content of a PNG file of 1 or 3 (RGB) planes of 8 bits. INVALID_ARGUMENT for other images.
StatusOr<std::vector<uint8_t>> EncodePng(const ByteImage& image);

}  // namespace tessera
