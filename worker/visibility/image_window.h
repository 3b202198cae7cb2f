// A rectangular part of a camera's image, and the camera of a pyramid level.
#pragma once

#include <algorithm>

#include "common/imaging/camera.h"

namespace tessera {

// Half-open rectangle of pixels.
struct PixelRect {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  int width() const { return x1 - x0; }
  int height() const { return y1 - y0; }
  bool empty() const { return x1 <= x0 || y1 <= y0; }
  double area() const { return static_cast<double>(width()) * height(); }
  bool Contains(const PixelRect& part) const {
    return x0 <= part.x0 && y0 <= part.y0 && x1 >= part.x1 && y1 >= part.y1;
  }
  // The smallest rectangle that contains both.
  PixelRect With(const PixelRect& other) const {
    return {std::min(x0, other.x0), std::min(y0, other.y0), std::max(x1, other.x1), std::max(y1, other.y1)};
  }
  bool operator==(const PixelRect&) const = default;
};

// A camera and the part of its image that is used. Pixels keep the coordinates that they have in the whole image, so
// results have the same bits for any window.
struct CameraWindow {
  PosedCamera camera;  // of the whole image
  PixelRect rect;

  CameraWindow() = default;
  CameraWindow(const PosedCamera& whole)  // NOLINT: implicit, a camera converts to the window of its whole image
      : camera(whole), rect{0, 0, whole.intrinsics.width, whole.intrinsics.height} {}
  CameraWindow(const PosedCamera& whole, const PixelRect& part) : camera(whole), rect(part) {}
};

// The camera of a pyramid level. Every level halves width and height, rounding down: an odd size loses its last column
// or row, so the pixel edges of all levels coincide.
inline PosedCamera PyramidCamera(PosedCamera camera, int level) {
  PinholeCamera& k = camera.intrinsics;
  for (int i = 0; i < level; ++i) {
    k.width &= ~1;
    k.height &= ~1;
    k = k.Resized(k.width / 2, k.height / 2);
  }
  return camera;
}

}  // namespace tessera
