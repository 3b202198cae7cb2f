#include "worker/photo/warp_target.h"

#include <algorithm>
#include <limits>

#include "common/base/parallel.h"
#include "worker/visibility/view_groups.h"

namespace tessera {
namespace {

constexpr int kRows = 64;

DepthRange RangeOf(const FaceMap& map) {
  const int bands = (map.height + kRows - 1) / kRows;
  std::vector<DepthRange> ranges(bands, {FaceMap::kNothing, 0});
  ParallelFor(map.height, kRows, [&](int64_t begin, int64_t end) {
    DepthRange& range = ranges[begin / kRows];
    const float* depth = map.depth.data();
    for (size_t i = begin * map.width; i < static_cast<size_t>(end) * map.width; ++i) {
      range.near_m = std::min(range.near_m, depth[i]);
      range.far_m = std::max(range.far_m, depth[i] < FaceMap::kNothing ? depth[i] : 0.0f);
    }
  });
  DepthRange all = {FaceMap::kNothing, 0};
  for (const DepthRange& range : ranges) {
    all = {std::min(all.near_m, range.near_m), std::max(all.far_m, range.far_m)};
  }
  return all.far_m > 0 ? all : DepthRange();
}

}  // namespace

void SetWarpTarget(const Texels& texels, const FaceMap& map, const DepthRange& range, WarpTarget* target) {
  target->texels = &texels;
  target->packed.resize(texels.luminance.size());
  std::fill(target->packed.begin() + static_cast<ptrdiff_t>(texels.Index(0, map.height)), target->packed.end(), 0u);
  const DepthRange& depths = range.empty() ? RangeOf(map) : range;
  // Codes 0..65533, so that rounding up never reaches kNothing.
  target->depth_min = depths.near_m;
  target->depth_step = std::max((depths.far_m - depths.near_m) / 65532, std::numeric_limits<float>::min());
  const float minimum = target->depth_min, per_depth = 1 / target->depth_step;
  ParallelForEach(map.height, kRows, [&](int64_t y) {
    const size_t row = texels.Index(0, static_cast<int>(y));
    const uint16_t* luminance = &texels.luminance[row];
    uint32_t* out = &target->packed[row];
    const float* depth = map.depth.data() + static_cast<size_t>(y) * map.width;
    const int32_t* face = map.face.data() + static_cast<size_t>(y) * map.width;
    for (int x = 0; x < map.width; ++x) {
      const float steps = std::clamp((depth[x] - minimum) * per_depth, -1.0f, 65534.0f);
      const int32_t code = 1 + static_cast<int32_t>(steps);
      const uint32_t visible = face[x] == kNotSelected ? 0 : luminance[x];
      out[x] = visible | static_cast<uint32_t>(code) << 16;
    }
    std::fill(out + map.width, out + texels.stride, 0u);
  });
}

}  // namespace tessera
