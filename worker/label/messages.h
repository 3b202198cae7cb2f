// Loopy belief propagation (min-sum) on a label field.
#ifndef TESSERA_WORKER_LABEL_MESSAGES_H_
#define TESSERA_WORKER_LABEL_MESSAGES_H_

#include <vector>

#include "worker/label/undecided_field.h"

namespace tessera {

struct Messages {
  std::vector<float> incoming;  // links x lanes: what reaches a link's face through it
  std::vector<float> beliefs;   // faces x lanes: a face's cost and all that reaches it
};

// Before the first iteration: nothing has been sent.
Messages NoMessages(const UndecidedField& undecided);

// Passes them on `iterations` times; every face sends to every neighbour at once. `damping`: share of the old message
// that is kept. Deterministic for any number of threads.
void PassMessages(const UndecidedField& undecided, int iterations, double damping, Messages* messages);

// Cost of each label of each face of the whole field (faces x classes) with everything else at its best, as far as
// the messages know; up to a constant a face.
std::vector<float> AllBeliefs(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& decided,
                              const UndecidedField& undecided, const Messages& messages);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_MESSAGES_H_
