#include "worker/visibility/view_groups.h"

#include <algorithm>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kPixelGrain = 1 << 16, kRowGrain = 64;

}  // namespace

void MarkNotLookedAt(const ViewGroups& groups, size_t view, FaceMap* map) {
  std::vector<uint8_t> looks(groups.looks.size());
  for (size_t g = 0; g < looks.size(); ++g) looks[g] = groups.looks[g][view];
  if (groups.group_of_face.empty() || std::find(looks.begin(), looks.end(), 0) == looks.end()) return;
  ParallelFor(static_cast<int64_t>(map->face.size()), kPixelGrain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      int32_t& face = map->face[i];
      if (face >= 0 && !looks[groups.group_of_face[face]]) face = kNotLookedAt;
    }
  });
}

void KeepNearOwn(const std::vector<uint8_t>& own, int margin_px, FaceMap* map) {
  // Along the rows first, then down the columns: whether a mark is as near as the margin.
  const auto widen = [margin_px](const uint8_t* in, int count, size_t stride, uint8_t* out) {
    int last = -2 * margin_px - 1;  // where a mark was seen, looking ahead by the margin
    for (int i = 0; i < count + margin_px; ++i) {
      if (i < count && in[i * stride]) last = i;
      const int at = i - margin_px;
      if (at >= 0 && at < count) out[at * stride] = i - last <= 2 * margin_px;
    }
  };
  const size_t width = map->width;
  std::vector<uint8_t> marks(map->face.size()), wide(marks.size());
  ParallelFor(map->height, kRowGrain, [&](int64_t begin, int64_t end) {
    for (int64_t y = begin; y < end; ++y) {
      for (size_t i = y * width; i < (y + 1) * width; ++i) marks[i] = map->face[i] >= 0 && own[map->face[i]] != 0;
      widen(&marks[y * width], map->width, 1, &wide[y * width]);
    }
  });
  ParallelFor(map->width, kRowGrain, [&](int64_t begin, int64_t end) {
    for (int64_t x = begin; x < end; ++x) widen(&wide[x], map->height, width, &marks[x]);
  });
  ParallelFor(static_cast<int64_t>(marks.size()), kPixelGrain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      if (!marks[i]) map->face[i] = -1;
    }
  });
}

}  // namespace tessera
