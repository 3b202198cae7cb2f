// Block coordinate descent on a label field: each block of cells changes its labels with all other blocks fixed, so
// that a change depends only on the blocks that are linked to it.
#pragma once

#include <cstdint>
#include <vector>

#include "worker/label/undecided_field.h"

namespace tessera {

// Labels below are indexed by undecided number. All functions are deterministic for any number of threads.

// Switches from `start` to `proposed` in those connected parts of a block where the switch lowers the energy,
// whichever of its two labels each face of another block has. Blocks decide independently, and the energy is never
// above that of `start`.
//
// Proof. Let x be the change of an edge's cost if its one end alone changes, y the same for the other end, and z if
// both change. If two blocks decide at its ends, one counts max(x, z / 2), the other max(y, z / 2): each at least the
// change of its end alone, and in sum at least z. Edges with one end that may change count x, edges within a part
// count z. So the sum of the counts of the switched parts, all below 0, bounds the energy's change from above.
std::vector<int32_t> ApplySafeParts(const UndecidedField& field, const Blocks& blocks,
                                    const std::vector<int32_t>& start, const std::vector<int32_t>& proposed);

// For each colour in turn, every block first switches the connected parts that lower the energy, for one proposal
// after another, then runs `expansion_rounds` rounds of expansion moves. All other blocks and the bridges are fixed
// meanwhile. So the energy never rises, and blocks of one colour can run concurrently: none reads another's changes.
//
// Dependency radius: a block reads the labels of linked faces, and of these only faces in blocks of earlier colours
// have changed. Its result therefore depends on the labels at the start of the sweep in the blocks within three links
// and in the faces linked to these, and on the proposals there.
void SweepBlocks(const UndecidedField& field, const Blocks& blocks,
                 const std::vector<const std::vector<int32_t>*>& proposals, int expansion_rounds,
                 std::vector<int32_t>* labels);

}  // namespace tessera
