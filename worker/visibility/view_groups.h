// What views see but do not look at, for every tile that has it alike.
#ifndef TESSERA_WORKER_VISIBILITY_VIEW_GROUPS_H_
#define TESSERA_WORKER_VISIBILITY_VIEW_GROUPS_H_

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "worker/visibility/rasterizer.h"

namespace tessera {

// Which views look at which faces: decided on the ground, so that every tile that has a face asks the same views.
struct ViewGroups {
  std::vector<uint32_t> group_of_face;      // empty: every view looks at every face
  std::vector<std::vector<uint8_t>> looks;  // of each group, one flag a view
};

// What FaceMap::face has where a view sees a face that it does not look at.
inline constexpr int32_t kNotLookedAt = std::numeric_limits<int32_t>::min();

// Marks such pixels of what `view` sees. Depths stay.
void MarkNotLookedAt(const ViewGroups& groups, size_t view, FaceMap* map);

// Sets FaceMap::face to -1 at every pixel that lies more than `margin_px` rows or columns from all pixels of faces with
// a flag in `own`. Depths stay.
void KeepNearOwn(const std::vector<uint8_t>& own, int margin_px, FaceMap* map);

}  // namespace tessera

#endif  // TESSERA_WORKER_VISIBILITY_VIEW_GROUPS_H_
