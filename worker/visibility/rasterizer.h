// Which face a pixel sees, and how deep: face and depth maps of a mesh from one camera, by scan conversion.
#ifndef TESSERA_WORKER_VISIBILITY_RASTERIZER_H_
#define TESSERA_WORKER_VISIBILITY_RASTERIZER_H_

#include <cstdint>
#include <limits>
#include <vector>

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

// Rows from the top, `width` x `height` pixels each.
struct FaceMap {
  static constexpr float kNothing = std::numeric_limits<float>::infinity();
  int width = 0;
  int height = 0;
  std::vector<int32_t> face;  // nearest face of the mesh through the pixel's centre; -1: none, or an occluder is nearer
  std::vector<float> depth;   // z in the camera's frame of whatever is nearest, occluders included; kNothing: nothing
};

// Draws `mesh`, and `occluders` (may be null) into depth alone, as `camera` sees them through its pixel centres. Both
// sides of faces count. A pixel centre on an edge belongs to exactly one of two faces that share it; of equally deep
// faces the one of lower index wins, and the mesh wins over occluders. Parts nearer than `near_m` are clipped. Depth is
// exact on planes (perspective-correct), to float rounding. Meshes and camera in the same frame, metres. Uses the
// process's threads; the result does not depend on their number.
FaceMap RasterizeFaces(const TriangleMesh& mesh, const TriangleMesh* occluders, const PosedCamera& camera,
                       double near_m = 1e-3);

// The part of `camera`'s image inside `rect` as an image of its own.
PosedCamera CroppedCamera(const PosedCamera& camera, const PixelRect& rect);

// The camera of a pyramid level: every level halves width and height (rounding down; of an odd size the last column or
// row has no counterpart and is cut, so that pixel edges of all levels coincide).
PosedCamera PyramidCamera(const PosedCamera& camera, int level);

// Smallest rectangle with all pixels that `mesh` may cover, grown by `margin_px` and clipped to the image, its corners
// rounded outward to multiples of `alignment_px` (but never past the image). The whole image where a face crosses the
// near plane inside the image's cone; empty where nothing is in sight.
PixelRect ProjectedBounds(const TriangleMesh& mesh, const PosedCamera& camera, int margin_px, int alignment_px,
                          double near_m = 1e-3);

}  // namespace tessera

#endif  // TESSERA_WORKER_VISIBILITY_RASTERIZER_H_
