#include "worker/refine/warp_target.h"

#include <algorithm>
#include <limits>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int kRows = 64;

}  // namespace

void SetWarpTarget(const Texels& texels, const FaceMap& map, WarpTarget* target) {
  target->texels = &texels;
  target->packed.resize(texels.luminance.size());
  const int bands = (map.height + kRows - 1) / kRows;
  std::vector<float> least(bands, FaceMap::kNothing), greatest(bands, 0);
  ParallelFor(map.height, kRows, [&](int64_t begin, int64_t end) {
    float low = FaceMap::kNothing, high = 0;
    const float* depth = map.depth.data();
    for (size_t i = begin * map.width; i < static_cast<size_t>(end) * map.width; ++i) {
      low = std::min(low, depth[i]);
      high = std::max(high, depth[i] < FaceMap::kNothing ? depth[i] : 0.0f);
    }
    least[begin / kRows] = low;
    greatest[begin / kRows] = high;
  });
  target->depth_min = bands > 0 ? *std::min_element(least.begin(), least.end()) : 0;
  const float depth_max = bands > 0 ? *std::max_element(greatest.begin(), greatest.end()) : 0;
  if (!(depth_max > 0)) target->depth_min = 0;
  // Codes 0..65533, so that rounding up never reaches kNothing.
  target->depth_step = std::max((depth_max - target->depth_min) / 65532, std::numeric_limits<float>::min());
  const float minimum = target->depth_min, per_depth = 1 / target->depth_step;
  ParallelFor(map.height, kRows, [&](int64_t begin, int64_t end) {
    for (int64_t y = begin; y < end; ++y) {
      const size_t row = texels.Index(0, static_cast<int>(y));
      const uint16_t* luminance = &texels.luminance[row];
      uint32_t* out = &target->packed[row];
      const float* depth = map.depth.data() + static_cast<size_t>(y) * map.width;
      for (int x = 0; x < map.width; ++x) {
        const float steps = std::min((depth[x] - minimum) * per_depth, 65534.0f);
        const int32_t code = 1 + static_cast<int32_t>(steps);
        out[x] = luminance[x] | static_cast<uint32_t>(code) << 16;
      }
      std::fill(out + map.width, out + texels.stride, 0u);
    }
  });
}

}  // namespace tessera
