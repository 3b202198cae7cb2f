// What stands between a tile and its cameras without being part of the tile.
#ifndef TESSERA_WORKER_TASKS_OCCLUDERS_H_
#define TESSERA_WORKER_TASKS_OCCLUDERS_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "common/scene/scene.h"
#include "common/tile/ground.h"
#include "common/tile/survey.h"
#include "worker/tasks/city_file.h"
#include "worker/visibility/image_window.h"

namespace tessera {

// Of the box from `low` to `high`.
std::array<Eigen::Vector3d, 8> CornersOf(const Eigen::Vector3d& low, const Eigen::Vector3d& high);

// What the views see of a tile, as windows of their images and depths. Immutable: may be asked from any thread at once.
class OccluderSearch {
 public:
  // `tile`: core and halo; `views`: those that the tile is refined from. Both in the local frame, needed here alone.
  OccluderSearch(const TriangleMesh& tile, const std::vector<SceneView>& views);

  // Whether anything within the convex hull of `points` (local frame) may lie before the tile in a view. Errs on the
  // side of yes: windows are rectangles around the tile's image.
  bool MayHide(std::span<const Eigen::Vector3d> points) const;
  // The same of all faces of a cell.
  bool MayHide(const SurveyCell& cell) const;

  // How far a surface within the hull of `points` may be displaced, metres, so that its image moves by `share_px`
  // pixels at most in any view in which it may hide the tile. Infinity if there is none, 0 where a camera is too near.
  double Tolerance(std::span<const Eigen::Vector3d> points, double share_px) const;

  // A window of an image, on the tile and a margin around it.
  struct Window {
    PosedCamera camera;  // of the whole image
    PixelRect rect;
    double depth_m = 0;  // of the tile's deepest vertex
  };
  const std::vector<Window>& windows() const { return windows_; }

 private:
  std::vector<Window> windows_;
};

// The faces of the city that may hide the tile from the views and are not in it, with the vertices they use, both in
// the order of their ids. `in_tile` is asked about a face's centroid (local frame). Reads the blocks that may hide
// anything one by one. Does not depend on the number of threads. Errors as CityReader::Block's.
StatusOr<TriangleMesh> FindOccluders(const CityReader& city, const Survey& survey,
                                     const std::function<bool(const Eigen::Vector3d&)>& in_tile,
                                     const OccluderSearch& search);

struct OccluderOptions {
  bool only_seen = true;   // false: what hides nothing is kept too
  double share_px = 0.25;  // silhouettes may move by this in the images; 0: no face is simplified
  double near_gsd = 16;    // nearer to the tile than this, all faces stay as they are
  int block_cells = 16;    // side of the squares of ground that are simplified each for itself
};

// Of `found`, what hides the tile in fact, with fewer faces. `near`: 1 for each face of `found` that must stay as it
// is. Left out are faces that lie behind others, behind the tile or beside it in every view: those with no pixel in
// front of the tile or next to its outline, nor a vertex in common with one that has. Then, beyond what is near,
// surfaces are simplified within options.share_px of a pixel (SimplifyMesh), their outlines locked. The tile's own
// outline stays closed, since its edges are outlines of `found`. Same bytes for any number of threads.
TriangleMesh ReduceOccluders(const TriangleMesh& found, const std::vector<uint8_t>& near, const TriangleMesh& tile,
                             const GroundPlane& ground, const OccluderSearch& search, const OccluderOptions& options);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_OCCLUDERS_H_
