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

// A pixel of a map, by its place in the rows one after another, at which nothing deeper may be compared.
struct BlindPixel {
  uint32_t pixel = 0;
  float depth = 0;  // z in the camera's frame
  bool operator==(const BlindPixel&) const = default;
};

// The pixels of a window at which a far silhouette passes. What stands more than a tile's halo away is never known as
// exactly as the tile itself (a neighbour moves it, or only an outline of it is at hand). So near such a line nothing
// that lies behind it may be compared, whether a run is tiled or not: how much of it is to be seen depends on what is
// in front. What is in front does not depend on what is behind.
struct FarSilhouettes {
  // A pixel of the whole image, and a depth between what is in front and what is behind.
  struct Passing {
    int32_t x = 0, y = 0;
    float depth = 0;
    bool operator==(const Passing&) const = default;
  };
  std::vector<Passing> passing;

  // The pixels within `radius_px` of such a line, in both directions, at a pyramid level, in order. `rect`: the part of
  // the whole image at that level whose pixels are meant.
  std::vector<BlindPixel> Near(int level, const PixelRect& rect, int radius_px) const;
};

// `map`: what the window of `camera` sees of mesh and occluders. Two pixels that touch are parted where the surfaces
// they see are more than `reach_m` from each other across `up`, or one sees nothing.
FarSilhouettes FindFarSilhouettes(const FaceMap& map, const PosedCamera& camera, const Eigen::Vector3d& up,
                                  double reach_m);

}  // namespace tessera

#endif  // TESSERA_WORKER_VISIBILITY_FAR_SILHOUETTES_H_
