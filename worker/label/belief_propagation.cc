#include "worker/label/belief_propagation.h"

#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"
#include "worker/label/block_turns.h"
#include "worker/label/field_graph.h"
#include "worker/label/messages.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
// Where messages go to and fro, other labels are best at the end than so many rounds before.
constexpr int kEarlier = 5;
// How much a face's own label is made to lead where the expansions overruled the messages.
constexpr float kLead = 1e-3f;

int32_t IndexOfLeast(const float* values, int count) {
  return static_cast<int32_t>(std::min_element(values, values + count) - values);
}

// The best labels by the messages, by the undecided field's numbers.
std::vector<int32_t> LabelsOfBeliefs(const UndecidedField& undecided, const Messages& messages) {
  std::vector<int32_t> labels(undecided.size());
  ParallelFor(static_cast<int64_t>(undecided.size()), kGrain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      labels[i] = IndexOfLeast(&messages.beliefs[i * undecided.lanes], undecided.classes);
    }
  });
  return labels;
}

double StartEnergy(const LabelField& field, std::vector<int32_t> start) {
  for (size_t f = 0; f < start.size(); ++f) {
    if (start[f] < 0) start[f] = IndexOfLeast(&field.unary[f * field.classes], field.classes);
  }
  return LabelEnergy(field, start);
}

}  // namespace

Labelling SolveLabels(const LabelField& field, const std::vector<int32_t>& start, const SolverOptions& options) {
  const int classes = field.classes;
  const int64_t faces = static_cast<int64_t>(field.faces());
  const FieldGraph graph = MakeFieldGraph(field);
  const std::vector<int32_t> decided = DecideFaces(field, graph);
  const UndecidedField undecided = MakeUndecidedField(field, graph, decided);
  Labelling result;
  result.start_energy = StartEnergy(field, start);

  Messages messages = NoMessages(undecided);
  const int early = std::max(0, options.iterations - kEarlier);
  PassMessages(undecided, early, options.damping, &messages);
  const std::vector<int32_t> early_labels = LabelsOfBeliefs(undecided, messages);
  PassMessages(undecided, options.iterations - early, options.damping, &messages);
  const std::vector<int32_t> last_labels = LabelsOfBeliefs(undecided, messages);
  result.beliefs = AllBeliefs(field, graph, decided, undecided, messages);

  // No labelling is better without the decided labels, so the others alone are compared.
  std::vector<int32_t> begin(undecided.size());
  for (size_t i = 0; i < begin.size(); ++i) {
    const int32_t label = start[undecided.faces[i]];
    begin[i] = label < 0 ? last_labels[i] : label;
  }
  const Blocks even = MakeBlocks(field, undecided, BlockGrid::kEven);
  const Blocks odd = MakeBlocks(field, undecided, BlockGrid::kOdd);
  const std::vector<const std::vector<int32_t>*> proposals = {&last_labels, &early_labels, &begin};
  std::vector<int32_t> labels = TakeSafeParts(undecided, even, begin, last_labels);
  TakeTurns(undecided, even, proposals, options.expansion_rounds, &labels);
  if (!field.cell.empty()) TakeTurns(undecided, odd, proposals, options.expansion_rounds, &labels);
  result.labels = decided;
  for (size_t i = 0; i < labels.size(); ++i) result.labels[undecided.faces[i]] = labels[i];
  result.energy = LabelEnergy(field, result.labels);

  ParallelFor(faces, kGrain, [&](int64_t first, int64_t end) {
    for (int64_t f = first; f < end; ++f) {
      float* belief = &result.beliefs[f * classes];
      float& own = belief[result.labels[f]];
      const int32_t least = IndexOfLeast(belief, classes);
      if (least != result.labels[f]) own = belief[least] - kLead;
      const float lowest = own;
      for (int l = 0; l < classes; ++l) belief[l] -= lowest;
    }
  });
  return result;
}

std::vector<float> LabelConfidence(int classes, const std::vector<float>& beliefs, const std::vector<int32_t>& labels) {
  std::vector<float> confidence(labels.size());
  for (size_t f = 0; f < labels.size(); ++f) {
    const float* belief = &beliefs[f * classes];
    float sum = 0;
    for (int l = 0; l < classes; ++l) sum += std::exp(belief[labels[f]] - belief[l]);
    confidence[f] = 1 / sum;
  }
  return confidence;
}

}  // namespace tessera
