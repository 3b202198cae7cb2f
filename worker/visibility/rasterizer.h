// Which face a pixel sees, and how deep: face and depth maps of a mesh from one camera, by scan conversion.
#ifndef TESSERA_WORKER_VISIBILITY_RASTERIZER_H_
#define TESSERA_WORKER_VISIBILITY_RASTERIZER_H_

#include <cstdint>
#include <functional>
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

// Rows from the top, `width` x `height` pixels each.
struct FaceMap {
  static constexpr float kNothing = std::numeric_limits<float>::infinity();
  int width = 0;
  int height = 0;
  std::vector<int32_t> face;  // nearest face of the mesh through the pixel's centre; -1: none, or an occluder is nearer
  std::vector<float> depth;   // z in the camera's frame of whatever is nearest, occluders included; kNothing: nothing
  int x0 = 0, y0 = 0;         // of the first pixel in the camera's whole image
};

// Makes `out`, whose buffers are used again, the part of a map in `rect` (of the whole image, within the map).
void CropFaceMap(const FaceMap& map, const PixelRect& rect, FaceMap* out);

// Draws `mesh`, and `occluders` (may be null) into depth alone, as a camera sees them through the pixel centres of a
// window; a pixel is the same bits in every window that holds it. Both
// sides of faces count. A pixel centre on an edge belongs to exactly one of two faces that share it; of equally deep
// faces the one of lower index wins, and the mesh wins over occluders. Parts nearer than `near_m` are clipped. Vertices
// are rounded to 2^-15 pixel in the image; on what they then span, depth is exact on planes (perspective-correct), to
// float rounding. Meshes and camera in the same frame, metres; pixel coordinates below 2^15. Uses the process's
// threads; the result does not depend on their number.
FaceMap RasterizeFaces(const TriangleMesh& mesh, const TriangleMesh* occluders, const CameraWindow& window,
                       double near_m = kNearPlane_m);

// Draws again and again without allocating: keeps its buffers (16 bytes a vertex and thread), and the maps keep theirs.
// One call at a time.
class Rasterizer {
 public:
  Rasterizer();
  ~Rasterizer();
  Rasterizer(Rasterizer&&) noexcept;
  Rasterizer& operator=(Rasterizer&&) noexcept;

  // As RasterizeFaces, the threads at work in bands of the one image.
  void Draw(const TriangleMesh& mesh, const TriangleMesh* occluders, const CameraWindow& window, FaceMap* map,
            double near_m = kNearPlane_m);

  // The same maps for many cameras, which are shared out among the threads: faster than one after another. `boxes`: of
  // the mesh as it lies.
  void DrawViews(const TriangleMesh& mesh, const CellBoxes& boxes, std::span<const CameraWindow> windows,
                 std::vector<FaceMap>* maps, double near_m = kNearPlane_m);

  // The same of a part of the mesh for each camera; the rest is not there.
  void DrawParts(const TriangleMesh& mesh, std::span<const MeshPart> parts, std::span<const CameraWindow> windows,
                 std::vector<FaceMap>* maps, double near_m = kNearPlane_m);

 private:
  struct Workspace;
  struct Pool;
  // Calls body(view, workspace) for each view, on as many threads as there are.
  void ForEachView(size_t views, const std::function<void(size_t view, Workspace& workspace)>& body);

  std::unique_ptr<Pool> pool_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_VISIBILITY_RASTERIZER_H_
