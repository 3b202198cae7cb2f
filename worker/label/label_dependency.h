// Dependency radius of the label solver: which faces must be present for a face to get the same label as in the whole
// field.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "worker/label/belief_propagation.h"

namespace tessera {

// The dependency radius is counted in three kinds of steps. A ring adds all faces that share an edge with the current
// faces. A link adds all blocks of the same grid with a face that shares an edge with a face of the current blocks. A
// turn does the same, but from each block only to blocks of earlier colours.
// The labels and beliefs of a face depend only on
//     the faces of the odd blocks within `odd_turns` turns of its own block, dilated by `odd_rings` rings, and for
//       these
//     the faces of the even blocks within `even_turns` turns of their blocks and then `even_links` links, dilated by
//       `rings` rings.
// SolveLabels therefore returns the same bytes for this face from every field that contains these faces, in the same
// order and with the same edges between them in the same order.
struct LabelDependencyRadius {
  int odd_turns = 0, odd_rings = 0;
  int even_turns = 0, even_links = 0, rings = 0;
};

// Proof, from the first stage of the solver to the last. "r of x" stands for x of all faces within r rings.
//     DecideFaces: a round is 1 of the previous round, so kDecideRounds in total.
//     Cost with the decided neighbours folded in: 1 of that.
//     Label of the messages: an iteration is 1 of the previous one, so `iterations` of that.
//     Label after ApplySafeParts: the messages' labels and start labels of the even block and 1 ring.
//     Label after the even sweep (SweepBlocks): of those in even blocks within kColours - 1 turns and in the faces
//       linked to these, which lie in blocks within 1 link more.
//     Label after the odd sweep: of those in odd blocks within kColours - 1 turns, and 1 of that.
// A belief is 2 of the messages' beliefs (FaceBeliefs), 1 of which is odd_rings, and depends on the face's own label.
LabelDependencyRadius LabelDependencyRadiusOf(const SolverOptions& options);

// Flags the faces within the dependency radius of the faces flagged in `core`. `face_links`: pairs of faces that
// share an edge, in any order; a superset of the field's edges. `cell`: as in LabelField.
std::vector<uint8_t> FacesInDependencyRadius(const std::vector<std::array<uint32_t, 2>>& face_links,
                                             const std::vector<Cell>& cell, const std::vector<uint8_t>& core,
                                             const LabelDependencyRadius& radius);

}  // namespace tessera
