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
// window that is being drawn) and those of the maps. Not thread-safe but for DrawPart: one call at a time.
// Visibility: both sides of faces are drawn. A pixel centre on an edge belongs to exactly one of the two faces that
// share it. Of equally deep faces the one of lower index wins.
// Precision: vertices are rounded to 2^-15 pixel in the image; depth is perspective-correct on the rounded face, to
// float rounding. A pixel has the same bits in every window that contains it.
// Meshes and cameras in the same frame, metres; pixel coordinates below 2^15. Uses the process's thread pool; the
// result does not depend on the number of threads.
class Rasterizer {
 public:
  // `most_bytes`: of projected vertices, but at least those of one window; 0: LookaheadLimit_bytes.
  explicit Rasterizer(int64_t most_bytes = 0);
  ~Rasterizer();
  Rasterizer(Rasterizer&&) noexcept;
  Rasterizer& operator=(Rasterizer&&) noexcept;

  // Draws parts[i] of the mesh for windows[i] into maps[i]; `maps` grows if it is shorter. The windows are distributed
  // over the threads; if there are at least twice as many threads, each window is drawn by several, in bands of rows.
  // Parts closer than `near_m` are clipped. `selections`: of the windows' views; empty: each is selected for all faces.
  // Faces for which a view is not selected hide others all the same.
  void DrawParts(const TriangleMesh& mesh, std::span<const MeshPart> parts, std::span<const CameraWindow> windows,
                 std::vector<FaceMap>* maps, double near_m = kNearPlane_m,
                 std::span<const FaceSelection> selections = {});

  // The same for one window, on the calling thread and those of the pool that are idle, together at most `threads`.
  // Thread-safe: at most MostAtOnce calls at a time.
  void DrawPart(const TriangleMesh& mesh, const MeshPart& part, const CameraWindow& window, FaceMap* map,
                double near_m = kNearPlane_m, const FaceSelection& selection = FaceSelection(), int threads = 1);
  // How many windows fit the bound; at least 1.
  size_t MostAtOnce(const TriangleMesh& mesh) const;

 private:
  struct Workspace;
  struct Pool;

  int64_t most_bytes_;
  std::unique_ptr<Pool> pool_;
};

}  // namespace tessera
