#include "worker/label/belief_propagation.h"

#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"
#include "worker/label/block_descent.h"
#include "worker/label/label_field.h"
#include "worker/label/messages.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
// Oscillating messages give different labels in different rounds. The labels this many rounds before the last are
// therefore proposed as well.
constexpr int kEarlyProposalRounds = 5;
// Margin by which a face's final label leads where the expansions changed it from the messages' label.
constexpr float kLabelMargin = 1e-3f;

int32_t IndexOfLeast(const float* values, int count) {
  return static_cast<int32_t>(std::min_element(values, values + count) - values);
}

// Labels of least belief, indexed by undecided number.
std::vector<int32_t> LabelsOfBeliefs(const UndecidedField& undecided, const Messages& messages) {
  std::vector<int32_t> labels(undecided.size());
  ParallelForEach(undecided.size(), kGrain, [&](int64_t i) {
    labels[i] = IndexOfLeast(&messages.beliefs[i * undecided.lanes], undecided.classes);
  });
  return labels;
}

}  // namespace

Labelling SolveLabels(const LabelField& field, const std::vector<int32_t>& start, const SolverOptions& options) {
  const int classes = field.classes;
  const FieldGraph graph = MakeFieldGraph(field);
  const std::vector<int32_t> decided = DecideFaces(field, graph);
  const UndecidedField undecided = MakeUndecidedField(field, graph, decided);
  Labelling result;

  Messages messages = InitialMessages(undecided);
  const int early = std::max(0, options.iterations - kEarlyProposalRounds);
  PassMessages(undecided, early, options.damping, &messages);
  const std::vector<int32_t> early_labels = LabelsOfBeliefs(undecided, messages);
  PassMessages(undecided, options.iterations - early, options.damping, &messages);
  const std::vector<int32_t> last_labels = LabelsOfBeliefs(undecided, messages);
  result.beliefs = FaceBeliefs(field, graph, decided, undecided, messages);

  // The decided labels are part of a best labelling, so only the undecided faces are optimised.
  std::vector<int32_t> begin(undecided.size());
  for (size_t i = 0; i < begin.size(); ++i) {
    const int32_t label = start[undecided.faces[i]];
    begin[i] = label < 0 ? last_labels[i] : label;
  }
  const Blocks even = MakeBlocks(field, undecided, BlockGrid::kEven);
  const Blocks odd = MakeBlocks(field, undecided, BlockGrid::kOdd);
  const std::vector<const std::vector<int32_t>*> proposals = {&last_labels, &early_labels, &begin};
  std::vector<int32_t> labels = ApplySafeParts(undecided, even, begin, last_labels);
  SweepBlocks(undecided, even, proposals, options.expansion_rounds, &labels);
  if (!field.cell.empty()) SweepBlocks(undecided, odd, proposals, options.expansion_rounds, &labels);
  result.labels = decided;
  for (size_t i = 0; i < labels.size(); ++i) result.labels[undecided.faces[i]] = labels[i];

  ParallelForEach(field.faces(), kGrain, [&](int64_t f) {
    float* belief = &result.beliefs[f * classes];
    float& own = belief[result.labels[f]];
    const int32_t least = IndexOfLeast(belief, classes);
    if (least != result.labels[f]) own = belief[least] - kLabelMargin;
    const float lowest = own;
    for (int l = 0; l < classes; ++l) belief[l] -= lowest;
  });
  return result;
}

std::vector<float> LabelConfidence(int classes, const std::vector<float>& beliefs, const std::vector<int32_t>& labels) {
  std::vector<float> confidence(labels.size());
  ParallelForEach(labels.size(), kGrain, [&](size_t f) {
    const float* belief = &beliefs[f * classes];
    float sum = 0;
    for (int l = 0; l < classes; ++l) sum += std::exp(belief[labels[f]] - belief[l]);
    confidence[f] = 1 / sum;
  });
  return confidence;
}

}  // namespace tessera
