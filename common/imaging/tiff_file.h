// Multi-page TIFF files. Uses libtiff.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/imaging/raster.h"

namespace tessera {

struct TiffSize {
  int width = 0, height = 0;
  int pages = 0;
};

// Size of the first page and the number of pages.
StatusOr<TiffSize> ReadTiffSize(const std::string& path);

// All pages as planes, values as stored (8- or 16-bit unsigned or 32-bit float; one sample per pixel; strips or tiles;
// any compression that libtiff supports). INVALID_ARGUMENT with the page (from 1) unless there are expected.pages pages
// of the size `expected`; sizes are checked before allocating.
StatusOr<FloatImage> ReadTiffPages(const std::string& path, const TiffSize& expected);
// The same for a part of each page, which must lie inside the page. Decodes only the strips or tiles of the part.
StatusOr<FloatImage> ReadTiffPages(const std::string& path, const TiffSize& expected, const ImagePart& part);

// Encodes 8-bit pages with LZW, one page per channel.
StatusOr<std::vector<uint8_t>> EncodeTiffPages(const ByteImage& pages);

}  // namespace tessera
