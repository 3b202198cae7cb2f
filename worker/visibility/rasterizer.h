// Face and depth maps of a mesh seen from one camera, by scan conversion.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "worker/visibility/image_window.h"
#include "worker/visibility/mesh_cells.h"

namespace tessera {

constexpr double kNearPlane_m = 1e-3;

// Row-major from the top, `width` x `height` pixels.
struct FaceMap {
  static constexpr float kNothing = std::numeric_limits<float>::infinity();
  int width = 0;
  int height = 0;
  std::vector<int32_t> face;  // nearest face at the pixel's centre, or kNotSelected; -1: none
  std::vector<float> depth;   // z in the camera frame of the nearest face; or kNothing
  int x0 = 0, y0 = 0;         // position of the first pixel in the camera's whole image
};

// Copies the part of `map` in `rect` (coordinates of the whole image, inside the map) to `out`, whose buffers are
// reused.
void CropFaceMap(const FaceMap& map, const PixelRect& rect, FaceMap* out);

// Renders meshes from the cameras of windows, sampled at pixel centres. Reuses its buffers (16 bytes per vertex and
// window that is being drawn) and those of the maps.
// Visibility: both sides of faces are drawn. A pixel centre on an edge belongs to exactly one of the two faces that
// share it. Of equally deep faces the one of lower index wins.
// Precision: vertices are rounded to 2^-15 pixel in the image; depth is perspective-correct on the rounded face, to
// float rounding. A pixel has the same bits in every window that contains it.
// Meshes and cameras in the same frame, metres; pixel coordinates below 2^15. Uses the process's thread pool; the
// result does not depend on the number of threads.
class Rasterizer {
 public:
  Rasterizer();
  ~Rasterizer();
  Rasterizer(Rasterizer&&) noexcept;
  Rasterizer& operator=(Rasterizer&&) noexcept;

  // Draws the part of the mesh for the window into `map`, on the calling thread and those of the pool that are idle,
  // together at most `threads`; with several, in bands of rows. Faces closer than `near_m` are clipped. Faces for which
  // the view is not selected hide others all the same. Thread-safe: at most MostAtOnce calls at a time.
  void DrawPart(const TriangleMesh& mesh, const MeshPart& part, const CameraWindow& window, FaceMap* map,
                double near_m = kNearPlane_m, const FaceSelection& selection = FaceSelection(), int threads = 1);
  // How many windows to draw at a time: their projected vertices fit LookaheadLimit_bytes. At least 1.
  size_t MostAtOnce(const TriangleMesh& mesh) const;

 private:
  struct Workspace;
  struct Pool;

  std::unique_ptr<Pool> pool_;
};

}  // namespace tessera
