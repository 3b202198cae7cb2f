// Image files that the project's writers do not write.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "common/imaging/raster.h"

namespace tessera::bent {

struct TiffForm {
  int width = 0, height = 0, channels = 1, bits = 8;
  bool is_float = false;
  bool has_alpha = false;  // the last channel
};

// A little-endian TIFF of one strip, not compressed. `pixels`: its bytes, channels interleaved.
std::string TiffBytes(const TiffForm& form, const std::string& pixels);

// A PNG of 8 bits: grey, RGB or RGBA; with a palette, `image` has indices.
std::string PngBytes(const ByteImage& image, const std::vector<std::array<uint8_t, 3>>& palette = {});

// The channels interleaved, as T times `factor`.
template <class T>
std::string Interleaved(const ByteImage& image, double factor) {
  std::vector<T> values;
  values.reserve(image.data.size());
  for (size_t i = 0; i < image.plane_size(); ++i) {
    for (int c = 0; c < image.channels; ++c) values.push_back(static_cast<T>(factor * image.plane(c)[i]));
  }
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

// `jpeg` with an EXIF segment whose only tag is the orientation (1 to 8).
std::string WithExifOrientation(const std::string& jpeg, int orientation);

}  // namespace tessera::bent
