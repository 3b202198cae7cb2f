// View selection per group of faces, and masks on face maps.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "worker/visibility/rasterizer.h"

namespace tessera {

// Which views are selected for which faces. The selection is made per ground cell, so that every tile that contains a
// face uses the same views for it.
struct ViewGroups {
  std::vector<uint32_t> group_of_face;         // empty: every view is selected for every face
  std::vector<std::vector<uint8_t>> selected;  // per group: one flag per view, 1 if selected
};

// FaceMap::face at pixels where a view sees a face for which it is not selected.
inline constexpr int32_t kNotSelected = std::numeric_limits<int32_t>::min();

// Marks such pixels in the map of `view`. Depths stay.
void MarkNotSelected(const ViewGroups& groups, size_t view, FaceMap* map);

// Sets FaceMap::face to -1 at every pixel that lies more than `margin_px` rows or columns from all pixels of faces
// with a flag in `own`. Depths stay.
void KeepNearOwn(const std::vector<uint8_t>& own, int margin_px, FaceMap* map);

}  // namespace tessera
