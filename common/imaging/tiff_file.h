// Multi-page TIFF files by libtiff, which stays behind this header.
#ifndef TESSERA_COMMON_IMAGING_TIFF_FILE_H_
#define TESSERA_COMMON_IMAGING_TIFF_FILE_H_

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

// All pages as planes, values as stored (8 or 16 bit unsigned, or 32-bit float; one sample a pixel; strips or tiles;
// any compression that libtiff knows). Every page must have the size `expected` (checked before anything is allocated),
// and there must be expected.pages of them. Errors name the page, counted from 1.
StatusOr<FloatImage> ReadTiffPages(const std::string& path, const TiffSize& expected);
// The same for a part of each page, which must lie within; decodes no strip or tile outside it.
StatusOr<FloatImage> ReadTiffPages(const std::string& path, const TiffSize& expected, const ImagePart& part);

// A page a channel, LZW, 8 bit.
StatusOr<std::vector<uint8_t>> EncodeTiffPages(const ByteImage& pages);

}  // namespace tessera

#endif  // TESSERA_COMMON_IMAGING_TIFF_FILE_H_
