#include "worker/visibility/view_groups.h"

#include <algorithm>

#include "common/base/parallel.h"

namespace tessera {

void MarkNotLookedAt(const ViewGroups& groups, size_t view, FaceMap* map) {
  std::vector<uint8_t> looks(groups.looks.size());
  for (size_t g = 0; g < looks.size(); ++g) looks[g] = groups.looks[g][view];
  if (groups.group_of_face.empty() || std::find(looks.begin(), looks.end(), 0) == looks.end()) return;
  constexpr int64_t kGrain = 1 << 16;
  ParallelFor(static_cast<int64_t>(map->face.size()), kGrain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      int32_t& face = map->face[i];
      if (face >= 0 && !looks[groups.group_of_face[face]]) face = kNotLookedAt;
    }
  });
}

void MarkBlind(std::span<const PixelRun> runs, FaceMap* map) {
  for (const PixelRun& run : runs) {
    for (uint32_t i = run.first; i < run.last; ++i) {
      if (map->face[i] >= 0) map->face[i] = Blinded(map->face[i]);
    }
  }
}

}  // namespace tessera
