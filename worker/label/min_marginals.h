// Min-marginals of a label field by loopy belief propagation.
#ifndef TESSERA_WORKER_LABEL_MIN_MARGINALS_H_
#define TESSERA_WORKER_LABEL_MIN_MARGINALS_H_

#include <vector>

#include "worker/label/field_graph.h"

namespace tessera {

// Cost of each label of each face (faces x classes) with everything else at its best, as far as the messages of
// `iterations` rounds know; up to a constant a face. `damping`: share of the old message that is kept. In every round
// every face sends to every neighbour at once. Faces whose messages cannot change whatever they receive - their own
// cost leads by more than their edges weigh - send them once and for all.
std::vector<float> MinMarginals(const LabelField& field, const FieldGraph& graph, int iterations, double damping);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_MIN_MARGINALS_H_
