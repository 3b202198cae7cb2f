// Loopy belief propagation (min-sum) on a label field.
#ifndef TESSERA_WORKER_LABEL_MESSAGES_H_
#define TESSERA_WORKER_LABEL_MESSAGES_H_

#include <vector>

#include "worker/label/open_field.h"

namespace tessera {

struct Messages {
  std::vector<float> incoming;  // links x lanes: what a link's face hears through it
  std::vector<float> beliefs;   // faces x lanes: a face's cost and all that it hears
};

// Nobody has heard anything.
Messages NoMessages(const OpenField& open);

// Passes them on `iterations` times; every face sends to every neighbour at once. `damping`: share of the old message
// that is kept. Deterministic for any number of threads.
void PassMessages(const OpenField& open, int iterations, double damping, Messages* messages);

// Cost of each label of each face of the whole field (faces x classes) with everything else at its best, as far as
// the messages know; up to a constant a face.
std::vector<float> AllBeliefs(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& decided,
                              const OpenField& open, const Messages& messages);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_MESSAGES_H_
