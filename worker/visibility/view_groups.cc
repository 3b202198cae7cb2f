#include "worker/visibility/view_groups.h"

#include <algorithm>
#include <limits>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kPixelGrain = 1 << 16, kRowGrain = 64;

}  // namespace

void MarkNotSelected(const ViewGroups& groups, size_t view, FaceMap* map) {
  std::vector<uint8_t> selected(groups.selected.size());
  for (size_t g = 0; g < selected.size(); ++g) selected[g] = groups.selected[g][view];
  if (groups.group_of_face.empty() || std::find(selected.begin(), selected.end(), 0) == selected.end()) return;
  ParallelForEach(map->face.size(), kPixelGrain, [&](int64_t i) {
    int32_t& face = map->face[i];
    if (face >= 0 && !selected[groups.group_of_face[face]]) face = kNotSelected;
  });
}

void KeepNearOwn(const std::vector<uint8_t>& own, int margin_px, FaceMap* map) {
  // A separable dilation of the own pixels: along rows first, then along columns.
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
    std::vector<int32_t> last(width, std::numeric_limits<int32_t>::min());  // per column: last row with a set pixel
    const auto take = [&](int64_t z) {
      if (z < 0 || z >= height || !has[z]) return;
      const uint8_t* row = wide.data() + z * width;
      for (int x = 0; x < width; ++x) last[x] = row[x] ? static_cast<int32_t>(z) : last[x];
    };
    for (int64_t z = begin - margin_px; z < begin + margin_px; ++z) take(z);
    for (int64_t y = begin; y < end; ++y) {
      take(y + margin_px);
      const auto first = static_cast<int32_t>(y - margin_px);
      int32_t* face = map->face.data() + y * width;
      for (int x = 0; x < width; ++x) face[x] = last[x] >= first ? face[x] : -1;
    }
  });
}

}  // namespace tessera
