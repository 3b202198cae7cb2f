// Minimises a label field by loopy belief propagation (min-sum), as in Bláha et al. 2017, and expansion moves.
#pragma once

#include <cstdint>
#include <vector>

#include "worker/label/label_field.h"

namespace tessera {

struct SolverOptions {
  int iterations = 30;   // fixed number, so that a face's label depends only on a bounded neighbourhood
  double damping = 0.3;  // weight of the old message in the new one
  int expansion_rounds = 2;
};

struct Labelling {
  std::vector<int32_t> labels;
  // faces x classes: approximate min-marginals, the cost of each label with all other faces at their best. The least
  // of a face is 0 and belongs to its label.
  std::vector<float> beliefs;
};

// Minimises E in three stages:
//   1. Damped synchronous message passing for a fixed number of iterations.
//   2. Faces switch from `start` to the messages' labels where that lowers the energy.
//   3. Block coordinate descent: block by block, better connected parts and expansion moves (block_descent.h).
// The energy is never above that of `start`. A label of -1 in `start` means: the messages' label. Deterministic for any
// number of threads. LabelDependencyRadiusOf (label_dependency.h) bounds what a face's label and beliefs depend on.
Labelling SolveLabels(const LabelField& field, const std::vector<int32_t>& start, const SolverOptions& options);

// Confidence in [0, 1] of each face's label: its softmax weight under -beliefs.
std::vector<float> LabelConfidence(int classes, const std::vector<float>& beliefs, const std::vector<int32_t>& labels);

}  // namespace tessera
