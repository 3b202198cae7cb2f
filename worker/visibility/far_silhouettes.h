// Silhouettes against what lies far off: where a surface ends in the image before or behind another that is no
// neighbour of it on the ground.
#ifndef TESSERA_WORKER_VISIBILITY_FAR_SILHOUETTES_H_
#define TESSERA_WORKER_VISIBILITY_FAR_SILHOUETTES_H_

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "common/imaging/camera.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Pixels [first, last) of a map's rows, one after another.
struct PixelRun {
  uint32_t first = 0, last = 0;
};

// The pixels of a window at which a far silhouette passes, a bit each. What stands more than a tile's halo away is
// never known as exactly as the tile itself (a neighbour moves it, or only an outline of it is at hand), so nothing may
// be compared across such a line, whether a run is tiled or not.
class FarSilhouettes {
 public:
  FarSilhouettes() = default;

  // `map`: what the window of `camera` sees of mesh and occluders. Two pixels that touch are parted where the surfaces
  // they see are more than `reach_m` from each other across `up`, or one sees nothing.
  FarSilhouettes(const FaceMap& map, const PosedCamera& camera, const Eigen::Vector3d& up, double reach_m);

  // The pixels within `radius_px` of such a line, in both directions, of the window at a pyramid level, in order.
  std::vector<PixelRun> Near(int level, int radius_px) const;

 private:
  int width_ = 0, height_ = 0;
  std::vector<bool> passes_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_VISIBILITY_FAR_SILHOUETTES_H_
