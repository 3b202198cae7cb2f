// Images in memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace tessera {

// `channels` planes of height x width values each, plane after plane, rows from the top, no padding.
template <class T>
struct Raster {
  int width = 0;
  int height = 0;
  int channels = 1;
  std::vector<T> data;

  Raster() = default;
  Raster(int w, int h, int c = 1, T value = T()) : width(w), height(h), channels(c) {
    data.assign(static_cast<size_t>(w) * h * c, value);
  }
  bool empty() const { return data.empty(); }
  size_t plane_size() const { return static_cast<size_t>(width) * height; }
  T* plane(int c) { return data.data() + plane_size() * c; }
  const T* plane(int c) const { return data.data() + plane_size() * c; }
  T& at(int x, int y, int c = 0) { return data[plane_size() * c + static_cast<size_t>(y) * width + x]; }
  const T& at(int x, int y, int c = 0) const { return data[plane_size() * c + static_cast<size_t>(y) * width + x]; }
};

using FloatImage = Raster<float>;
using ByteImage = Raster<uint8_t>;
using LabelImage = Raster<uint8_t>;  // class index per pixel, 255: none

// Half-open rectangle of an image's pixels.
struct ImagePart {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  int width() const { return x1 - x0; }
  int height() const { return y1 - y0; }
  bool operator==(const ImagePart&) const = default;
};

// Maps the centre of pixel (x, y) of one image to scale (x + 0.5, y + 0.5) + offset in another image (pixel centres at
// +0.5).
struct PixelMapping {
  double scale_x = 1, scale_y = 1;
  double offset_x = 0, offset_y = 0;
  // First available pixel of the other image. Positions refer to the whole other image, so that results do not depend
  // on the part that is loaded.
  int first_x = 0, first_y = 0;
};

}  // namespace tessera
