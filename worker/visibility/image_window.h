// Parts and pyramid levels of a camera's image, and the part that a mesh covers.
#ifndef TESSERA_WORKER_VISIBILITY_IMAGE_WINDOW_H_
#define TESSERA_WORKER_VISIBILITY_IMAGE_WINDOW_H_

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"

namespace tessera {

// Half-open rectangle of pixels.
struct PixelRect {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  int width() const { return x1 - x0; }
  int height() const { return y1 - y0; }
  bool empty() const { return x1 <= x0 || y1 <= y0; }
  bool operator==(const PixelRect&) const = default;
};

// What is looked at of a camera's image. Pixels keep the coordinates that they have in the whole image, so that what is
// computed from them is the same bits whatever the window.
struct CameraWindow {
  PosedCamera camera;  // of the whole image
  PixelRect rect;

  CameraWindow() = default;
  CameraWindow(const PosedCamera& whole)  // NOLINT: a camera is a window on all of its image
      : camera(whole), rect{0, 0, whole.intrinsics.width, whole.intrinsics.height} {}
  CameraWindow(const PosedCamera& whole, const PixelRect& part) : camera(whole), rect(part) {}
};

// The camera of a pyramid level: every level halves width and height (rounding down; of an odd size the last column or
// row has no counterpart and is cut, so that pixel edges of all levels coincide).
PosedCamera PyramidCamera(const PosedCamera& camera, int level);

// Smallest rectangle with all pixels that `mesh` may cover, grown by `margin_px` and clipped to the image, its corners
// rounded outward to multiples of `alignment_px` (but never past the image). The whole image where a face crosses the
// near plane inside the image's cone; empty where nothing is in sight.
PixelRect ProjectedBounds(const TriangleMesh& mesh, const PosedCamera& camera, int margin_px, int alignment_px,
                          double near_m = 1e-3);

}  // namespace tessera

#endif  // TESSERA_WORKER_VISIBILITY_IMAGE_WINDOW_H_
