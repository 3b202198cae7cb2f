// An independent solver for label fields: CGAL's alpha expansion by graph cuts (Boykov et al. 2001).
#ifndef TESSERA_TESTS_SUPPORT_ALPHA_EXPANSION_H_
#define TESSERA_TESTS_SUPPORT_ALPHA_EXPANSION_H_

#include <cstdint>
#include <vector>

#include "worker/label/label_field.h"

namespace tessera {

// No expansion of any one label lowers the energy of the result any more. `labels`: where it starts, every one in
// [0, classes). Slow.
std::vector<int32_t> ExpandLabels(const LabelField& field, std::vector<int32_t> labels);

}  // namespace tessera

#endif  // TESSERA_TESTS_SUPPORT_ALPHA_EXPANSION_H_
