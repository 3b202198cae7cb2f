// An independent solver for label fields: CGAL's alpha expansion by graph cuts (Boykov et al. 2001).
#pragma once

#include <cstdint>
#include <vector>

#include "worker/label/label_field.h"

namespace tessera {

// Expands labels until no expansion of a single label lowers the energy. `labels`: initial labels in [0, classes).
// Slow.
std::vector<int32_t> ExpandLabels(const LabelField& field, std::vector<int32_t> labels);

}  // namespace tessera
