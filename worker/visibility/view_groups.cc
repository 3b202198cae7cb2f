#include "worker/visibility/view_groups.h"

#include <algorithm>
#include <cassert>
#include <cstring>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kRowGrain = 64;

}  // namespace

std::vector<uint8_t> ViewGroups::SelectedIn(size_t view) const {
  std::vector<uint8_t> out(group_of_face.empty() ? 0 : selected.size());
  for (size_t g = 0; g < out.size(); ++g) out[g] = selected[g][view];
  if (std::find(out.begin(), out.end(), 0) == out.end()) out.clear();
  return out;
}

void KeepNearOwn(const std::vector<uint8_t>& own, int margin_px, FaceMap* map) {
  // A separable dilation of the own pixels: along rows first, then along columns.
  assert(margin_px < 128);
  const int width = map->width, height = map->height;
  std::vector<uint8_t> wide(map->face.size(), 0), has(height, 0);  // pixels, rows with any
  ParallelForEach(height, kRowGrain, [&](int64_t y) {
    const int32_t* face = map->face.data() + y * width;
    uint8_t* row = wide.data() + y * width;
    int marked = 0;  // columns before it are final
    for (int x = 0; x < width; ++x) {
      if (face[x] < 0 || !own[face[x]]) continue;
      const int first = std::max(marked, x - margin_px), last = std::min(width, x + margin_px + 1);
      std::fill(row + first, row + last, 1);
      marked = last;
      has[y] = 1;
    }
  });
  ParallelFor(height, kRowGrain, [&](int64_t begin, int64_t end) {
    std::vector<uint8_t> near(width, 0);  // per column: number of set pixels in the rows within the margin
    const auto add = [&](int64_t z, uint8_t sign) {
      if (z < 0 || z >= height || !has[z]) return;
      const uint8_t* row = wide.data() + z * width;
      for (int x = 0; x < width; ++x) near[x] = static_cast<uint8_t>(near[x] + sign * row[x]);
    };
    for (int64_t z = begin - margin_px; z < begin + margin_px; ++z) add(z, 1);
    for (int64_t y = begin; y < end; ++y) {
      add(y + margin_px, 1);
      int32_t* face = map->face.data() + y * width;
      for (int x = 0; x < width;) {
        const void* const far = std::memchr(near.data() + x, 0, static_cast<size_t>(width - x));
        if (far == nullptr) break;
        for (x = static_cast<int>(static_cast<const uint8_t*>(far) - near.data()); x < width && near[x] == 0; ++x) {
          face[x] = -1;
        }
      }
      add(y - margin_px, 255);  // takes the row away
    }
  });
}

}  // namespace tessera
