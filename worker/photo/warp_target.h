// The target side of a pair: luminance and nearest depth of a view, interleaved.
#pragma once

#include <cstdint>

#include "worker/photo/texels.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {

// Depth range of a view's targets, metres. Nearer depths are clamped to `near_m`, farther ones count as no surface.
struct DepthRange {
  float near_m = 0, far_m = 0;
  bool empty() const { return !(far_m > near_m); }
};

// Rebuilt when the surface has moved. Refers to the view's texels.
struct WarpTarget {
  static constexpr uint32_t kNothing = 65535;  // code of a pixel without surface
  const Texels* texels = nullptr;
  // Lower 16 bits: luminance as in the texels. Upper 16 bits: code of the nearest depth, rounded up by less than one
  // step: depth_min + code·depth_step. Rows as in the texels.
  LineVector<uint32_t> packed;
  float depth_min = 0, depth_step = 1;

  // z of the nearest surface at a pixel; infinity if there is none.
  float Depth(int x, int y) const {
    const uint32_t code = packed[texels->Index(x, y)] >> 16;
    return code == kNothing ? FaceMap::kNothing : depth_min + static_cast<float>(code) * depth_step;
  }
};

// `map`: of the view of `texels`, same size. Faces for which the view is not selected (kNotSelected) occlude but
// have no luminance. The depth codes depend on `range`, so views that must agree share it; empty: the range of `map`.
// Runs on all threads.
void SetWarpTarget(const Texels& texels, const FaceMap& map, const DepthRange& range, WarpTarget* target);

}  // namespace tessera
