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

void MarkBlind(std::span<const BlindPixel> blind, FaceMap* map) {
  for (const auto& [i, depth] : blind) {
    int32_t& face = map->face[i];
    if (!(map->depth[i] > depth) || face < -1) continue;
    face = face >= 0 ? Blinded(face) : kNotLookedAt;  // an occluder may be another tile's face
  }
}

}  // namespace tessera
