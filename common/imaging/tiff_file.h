// TIFF files: likelihoods of several pages, and photographs. Uses libtiff.
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

// The first page of a photograph.
struct TiffPhotographHeader {
  int width = 0, height = 0;
  int bits = 8;  // per sample
  bool has_alpha = false;
  int orientation = 1;     // the tag
  int highest_sample = 0;  // the tag MaxSampleValue; 0: there is none
};
StatusOr<TiffPhotographHeader> ReadTiffPhotographHeader(const std::string& path);

// Decodes the first page as stored, whatever its orientation, to 8 or 16 bits and 1 (grey), 3 (BGR) or 4 (BGRA)
// channels. The fourth channel is alpha that the file declares; other additional bands are dropped. INVALID_ARGUMENT
// with what is expected for other samples or more bands. The caller has checked the size in the header.
Status DecodeTiffPhotograph(const std::string& path, cv::Mat* image);

// Encodes 8-bit pages with LZW, one page per channel.
StatusOr<std::vector<uint8_t>> EncodeTiffPages(const ByteImage& pages);

}  // namespace tessera
