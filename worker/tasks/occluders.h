// What stands between a tile and its cameras without being part of the tile.
#ifndef TESSERA_WORKER_TASKS_OCCLUDERS_H_
#define TESSERA_WORKER_TASKS_OCCLUDERS_H_

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/imaging/camera.h"
#include "common/scene/scene.h"
#include "common/tile/survey.h"
#include "worker/visibility/image_window.h"

namespace tessera {

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

 private:
  struct Window {
    PosedCamera camera;
    PixelRect rect;
    double depth_m = 0;  // of the tile's deepest vertex
  };
  static bool MayHide(std::span<const Eigen::Vector3d> points, const Window& window);

  std::vector<Window> windows_;
};

// The faces of `city`, ascending, that may hide the tile from the views and are not in it (`in_tile`: one flag a face).
// Does not depend on the number of threads.
std::vector<uint32_t> FindOccluders(const TriangleMesh& city, const Survey& survey, const std::vector<uint8_t>& in_tile,
                                    const OccluderSearch& search);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_OCCLUDERS_H_
