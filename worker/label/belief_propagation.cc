#include "worker/label/belief_propagation.h"

#include <algorithm>
#include <cmath>

#include "common/base/parallel.h"
#include "worker/label/expansion.h"
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

// The labels of the undecided faces that the messages say are best.
void SayLabels(const OpenField& open, const Messages& messages, std::vector<int32_t>* labels) {
  ParallelFor(static_cast<int64_t>(open.size()), kGrain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      (*labels)[open.faces[i]] = IndexOfLeast(&messages.beliefs[i * open.lanes], open.classes);
    }
  });
}

void TakeBetter(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& other,
                std::vector<int32_t>* labels) {
  const int classes = field.classes;
  const size_t faces = labels->size();
  std::vector<uint8_t> seen(faces, 0);
  std::vector<uint32_t> part;
  const std::vector<int32_t> before = *labels;
  for (size_t start = 0; start < faces; ++start) {
    if (seen[start] || other[start] == before[start]) continue;
    part.assign(1, static_cast<uint32_t>(start));
    seen[start] = 1;
    double gain = 0;
    for (size_t i = 0; i < part.size(); ++i) {
      const uint32_t f = part[i];
      gain += static_cast<double>(field.unary[static_cast<size_t>(f) * classes + before[f]]) -
              field.unary[static_cast<size_t>(f) * classes + other[f]];
      for (const FieldLink& link : graph[f]) {
        const uint32_t g = link.face;
        const bool inside = other[g] != before[g];
        if (inside && g < f) continue;  // counted from the other end
        const double change = (before[f] != before[g] ? 1 : 0) - (other[f] != other[g] ? 1 : 0);
        gain += change * link.weight;
      }
      for (const FieldLink& link : graph[f]) {
        const uint32_t g = link.face;
        if (!seen[g] && other[g] != before[g]) {
          seen[g] = 1;
          part.push_back(g);
        }
      }
    }
    if (gain > 0) {
      for (const uint32_t f : part) (*labels)[f] = other[f];
    }
  }
}

}  // namespace

void TakeBetterParts(const LabelField& field, const std::vector<int32_t>& other, std::vector<int32_t>* labels) {
  TakeBetter(field, MakeFieldGraph(field), other, labels);
}

Labelling SolveLabels(const LabelField& field, const std::vector<int32_t>& start, const SolverOptions& options) {
  const int classes = field.classes;
  const int64_t faces = static_cast<int64_t>(field.faces());
  const FieldGraph graph = MakeFieldGraph(field);
  const std::vector<int32_t> decided = DecideFaces(field, graph);
  const OpenField open = MakeOpenField(field, graph, decided);
  Labelling result;
  std::vector<int32_t> begin = start;
  for (int64_t f = 0; f < faces; ++f) {
    if (begin[f] < 0) begin[f] = IndexOfLeast(&field.unary[f * classes], classes);
  }
  result.start_energy = LabelEnergy(field, begin);
  // No labelling is better without the decided labels, so the others alone are compared.
  for (int64_t f = 0; f < faces; ++f) {
    if (decided[f] != kUndecided) begin[f] = decided[f];
  }

  Messages messages = NoMessages(open);
  const int early = std::max(0, options.iterations - kEarlier);
  PassMessages(open, early, options.damping, &messages);
  std::vector<int32_t> early_labels = decided;
  SayLabels(open, messages, &early_labels);
  PassMessages(open, options.iterations - early, options.damping, &messages);
  result.labels = decided;
  SayLabels(open, messages, &result.labels);
  TakeBetter(field, graph, early_labels, &result.labels);
  TakeBetter(field, graph, begin, &result.labels);
  result.beliefs = AllBeliefs(field, graph, decided, open, messages);

  std::vector<int32_t> open_labels(open.size());
  for (size_t i = 0; i < open.size(); ++i) open_labels[i] = result.labels[open.faces[i]];
  LowerByExpansions(open, options.expansion_rounds, options.part_faces, &open_labels);
  for (size_t i = 0; i < open.size(); ++i) result.labels[open.faces[i]] = open_labels[i];
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
