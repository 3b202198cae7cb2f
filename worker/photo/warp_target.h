// The other side of a pair: what a warp reads of a view, luminance and nearest depth together.
#ifndef TESSERA_WORKER_PHOTO_WARP_TARGET_H_
#define TESSERA_WORKER_PHOTO_WARP_TARGET_H_

#include <cstdint>

#include "worker/photo/texels.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Depths that a view's targets can hold, metres. What is nearer counts as `near`, what is farther as nothing.
struct DepthRange {
  float near_m = 0, far_m = 0;
  bool empty() const { return !(far_m > near_m); }
};

// Made anew when the surface has moved. Refers to the view's texels.
struct WarpTarget {
  static constexpr uint32_t kNothing = 65535;  // code of a pixel that sees no surface
  const Texels* texels = nullptr;
  // Luminance as in the texels, and above it the code of the depth of the nearest surface, rounded up by less than a
  // step: depth_min + code·depth_step. Rows as in the texels.
  LineVector<uint32_t> packed;
  float depth_min = 0, depth_step = 1;

  // z of the nearest surface at a pixel; infinity where there is none.
  float Depth(int x, int y) const {
    const uint32_t code = packed[texels->Index(x, y)] >> 16;
    return code == kNothing ? FaceMap::kNothing : depth_min + static_cast<float>(code) * depth_step;
  }
};

// `map`: what the view of `texels` sees, of the same size; what it sees but does not look at (MarkNotLookedAt) hides
// and has no luminance. Codes depend on `range`, so views that are to agree share it; empty: that of the map. Uses the
// process's threads.
void SetWarpTarget(const Texels& texels, const FaceMap& map, const DepthRange& range, WarpTarget* target);

}  // namespace tessera

#endif  // TESSERA_WORKER_PHOTO_WARP_TARGET_H_
