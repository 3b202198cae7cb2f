// Minimises a label field by loopy belief propagation (min-sum), as Bláha et al. 2017 do.
#ifndef TESSERA_WORKER_LABEL_BELIEF_PROPAGATION_H_
#define TESSERA_WORKER_LABEL_BELIEF_PROPAGATION_H_

#include <cstdint>
#include <vector>

#include "worker/label/label_field.h"

namespace tessera {

struct SolverOptions {
  int iterations = 30;   // always all of them, so that a face's label depends on its surroundings alone
  double damping = 0.3;  // share of the old message that is kept
  int expansion_rounds = 2;
};

struct Labelling {
  std::vector<int32_t> labels;
  // faces x classes: cost of each label with everything else at its best, as far as the messages know; the least of a
  // face is 0 and belongs to its label.
  std::vector<float> beliefs;
  double energy = 0;
  double start_energy = 0;
};

// All messages are sent at once, damped, for a fixed number of iterations. From the start, faces take the labels that
// the messages say where that lowers the energy; then cell after cell takes better parts and expansions lower the
// energy further (cell_turns.h). So it is never above that of `start`. Labels of -1 in `start` stand for what the
// messages say, in start_energy for the unary's best. Deterministic for any number of threads; ReachOf (label_reach.h)
// bounds what a face's label and beliefs depend on.
Labelling SolveLabels(const LabelField& field, const std::vector<int32_t>& start, const SolverOptions& options);

// Probability-like confidence in [0, 1] of each face's label: its share in exp(-beliefs).
std::vector<float> LabelConfidence(int classes, const std::vector<float>& beliefs, const std::vector<int32_t>& labels);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_BELIEF_PROPAGATION_H_
