// How far the label solver looks: what must be there for a face's label to be that of the whole field.
#ifndef TESSERA_WORKER_LABEL_LABEL_REACH_H_
#define TESSERA_WORKER_LABEL_LABEL_REACH_H_

#include <array>
#include <cstdint>
#include <vector>

#include "worker/label/belief_propagation.h"

namespace tessera {

// Steps outward from a face. A ring: all faces that share an edge with those so far. A link: from a block of cells to
// all blocks of the same grid that a face of it shares an edge with. The labels and beliefs of a face depend on nothing
// outside
//   the faces of the odd blocks within `odd_links` links of its own, grown by `odd_rings` rings, and of these
//   the faces of the even blocks within `even_links` links of theirs, grown by `rings` rings.
// So SolveLabels gives it the same bytes from all fields that hold these faces, in the same order and with the same
// edges between them in the same order; all others may differ or not be there.
struct LabelReach {
  int odd_links = 0, odd_rings = 0;
  int even_links = 0, rings = 0;
};

// Proof, from the first step of the solver to the last; "r of x" is x of all faces within r rings.
//   whether and how a face is decided (DecideFaces): a round is 1 of the round before: kDecideRounds
//   its cost beside decided faces: 1 of that
//   its message's label: an iteration is 1 of the iteration before: `iterations` of that
//   its label before all turns (TakeSafeParts): the even block's and 1 of messages' labels and starts
//   after the even turns (TakeTurns): of those in even blocks within 3 links, and in the faces linked to these, whose
//     blocks lie within 4
//   after the odd turns: of those in odd blocks within 3 links, and 1 of that.
// A belief is 2 of the messages' beliefs (AllBeliefs), 1 of which is odd_rings, and follows the face's own label.
LabelReach ReachOf(const SolverOptions& options);

// Flags of the faces within reach of those flagged in `core`. `face_links`: pairs of faces that share an edge, in any
// order; more than the field's edges do no harm. `cell`: as in LabelField.
std::vector<uint8_t> FacesInReach(const std::vector<std::array<uint32_t, 2>>& face_links, const std::vector<Cell>& cell,
                                  const std::vector<uint8_t>& core, const LabelReach& reach);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_LABEL_REACH_H_
