// Expansion moves (Boykov et al. 2001) that look only where a label has anything to win.
#ifndef TESSERA_WORKER_LABEL_EXPANSION_H_
#define TESSERA_WORKER_LABEL_EXPANSION_H_

#include <cstdint>
#include <vector>

#include "worker/label/open_field.h"

namespace tessera {

// Lets one label after the other take all the faces it can win, `rounds` times or until nothing changes: never raises
// the energy. Exact where the faces that a label could possibly win hang together in parts of no more than
// `part_faces`; larger ones are worked off piece by piece. Deterministic for any number of threads.
void LowerByExpansions(const OpenField& open, int rounds, int part_faces, std::vector<int32_t>* labels);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_EXPANSION_H_
