// The solver's last part: labels are chosen block by block, with all other blocks fixed, so that no choice reaches
// further than from a block to those that it is linked to.
#ifndef TESSERA_WORKER_LABEL_BLOCK_TURNS_H_
#define TESSERA_WORKER_LABEL_BLOCK_TURNS_H_

#include <cstdint>
#include <vector>

#include "worker/label/undecided_field.h"

namespace tessera {

// All labels below are by the field's numbers. All of it is deterministic for any number of threads.

// `start` with those connected parts of the blocks in which `proposed` differs that lower the energy whichever of the
// two labels the faces of other blocks have: every block chooses for itself, and the energy is never above that of
// `start`.
//
// Proof. Let x be the change of an edge's cost if its one end alone changes, y the same for the other end, and z if
// both change. Where two blocks choose at its ends, the one counts max(x, z / 2), the other max(y, z / 2): each no less
// than what it does alone, and together no less than z. Edges with one end that may change count x, those within a part
// z. So the counts of the parts that are taken, none above 0, add up to no less than the energy's change.
std::vector<int32_t> TakeSafeParts(const UndecidedField& field, const Blocks& blocks, const std::vector<int32_t>& start,
                                   const std::vector<int32_t>& proposed);

// Colour by colour, every block takes the connected parts that lower the energy from one proposal after the other, then
// expands its labels `expansion_rounds` times. All other blocks stay as they are in its turn, and bridges always. So
// nothing ever raises the energy, and blocks of one colour, worked off at once, never see each other's changes.
//
// Reach. In its turn a block reads labels of the faces that it is linked to, and of these only the ones in blocks of
// earlier colours have changed: its result follows from the labels before all turns in the blocks within three links
// and in the faces linked to these, and from the proposals there.
void TakeTurns(const UndecidedField& field, const Blocks& blocks,
               const std::vector<const std::vector<int32_t>*>& proposals, int expansion_rounds,
               std::vector<int32_t>* labels);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_BLOCK_TURNS_H_
