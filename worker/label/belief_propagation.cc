#include "worker/label/belief_propagation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 2048;
// How much a face's own label is made to lead where polishing overruled the messages.
constexpr float kLead = 1e-3f;

// For every face its edges: where they lead, what they weigh, and the slot of the same edge at the other end.
struct Adjacency {
  std::vector<int64_t> offsets;
  std::vector<uint32_t> neighbour;
  std::vector<float> weight;
  std::vector<int64_t> reverse;
};

Adjacency MakeAdjacency(const LabelField& field) {
  Adjacency a;
  a.offsets.assign(field.faces() + 1, 0);
  for (const FieldEdge& e : field.edges) {
    ++a.offsets[e.face0 + 1];
    ++a.offsets[e.face1 + 1];
  }
  std::partial_sum(a.offsets.begin(), a.offsets.end(), a.offsets.begin());
  const size_t slots = 2 * field.edges.size();
  a.neighbour.resize(slots);
  a.weight.resize(slots);
  a.reverse.resize(slots);
  std::vector<int64_t> next(a.offsets.begin(), a.offsets.end() - 1);
  for (const FieldEdge& e : field.edges) {
    const int64_t s0 = next[e.face0]++, s1 = next[e.face1]++;
    a.neighbour[s0] = e.face1;
    a.neighbour[s1] = e.face0;
    a.weight[s0] = a.weight[s1] = e.weight;
    a.reverse[s0] = s1;
    a.reverse[s1] = s0;
  }
  return a;
}

int32_t IndexOfLeast(const float* values, int count) {
  return static_cast<int32_t>(std::min_element(values, values + count) - values);
}

void SumBeliefs(const LabelField& field, const Adjacency& a, const std::vector<float>& incoming, int64_t face,
                float* belief) {
  const int classes = field.classes;
  const float* unary = &field.unary[face * classes];
  std::copy(unary, unary + classes, belief);
  for (int64_t s = a.offsets[face]; s < a.offsets[face + 1]; ++s) {
    for (int l = 0; l < classes; ++l) belief[l] += incoming[s * classes + l];
  }
}

// Min-marginals after `iterations` rounds in which every face sends to every neighbour at once.
std::vector<float> PropagateBeliefs(const LabelField& field, const Adjacency& a, const SolverOptions& options) {
  const int classes = field.classes;
  const int64_t faces = static_cast<int64_t>(field.faces());
  // incoming[s]: the message that slot s's face has from its neighbour.
  std::vector<float> incoming(a.neighbour.size() * classes, 0.0f), next(incoming.size());
  const float keep = static_cast<float>(options.damping);
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    ParallelFor(faces, kGrain, [&](int64_t begin, int64_t end) {
      std::vector<float> belief(classes), message(classes);
      for (int64_t f = begin; f < end; ++f) {
        SumBeliefs(field, a, incoming, f, belief.data());
        for (int64_t s = a.offsets[f]; s < a.offsets[f + 1]; ++s) {
          const float* from = &incoming[s * classes];
          float least = std::numeric_limits<float>::infinity();
          for (int l = 0; l < classes; ++l) {
            message[l] = belief[l] - from[l];
            least = std::min(least, message[l]);
          }
          const float* old = &incoming[a.reverse[s] * classes];
          float* out = &next[a.reverse[s] * classes];
          for (int l = 0; l < classes; ++l) {
            const float potts = std::min(message[l] - least, a.weight[s]);
            out[l] = keep * old[l] + (1 - keep) * potts;
          }
        }
      }
    });
    incoming.swap(next);
  }
  std::vector<float> beliefs(faces * classes);
  ParallelFor(faces, kGrain, [&](int64_t begin, int64_t end) {
    for (int64_t f = begin; f < end; ++f) SumBeliefs(field, a, incoming, f, &beliefs[f * classes]);
  });
  return beliefs;
}

void Polish(const LabelField& field, const Adjacency& a, int sweeps, std::vector<int32_t>* labels) {
  const int classes = field.classes;
  std::vector<float> cost(classes);
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    bool changed = false;
    for (size_t f = 0; f < labels->size(); ++f) {
      const float* unary = &field.unary[f * classes];
      std::copy(unary, unary + classes, cost.begin());
      float all = 0;
      for (int64_t s = a.offsets[f]; s < a.offsets[f + 1]; ++s) {
        all += a.weight[s];
        cost[(*labels)[a.neighbour[s]]] -= a.weight[s];
      }
      const int32_t best = IndexOfLeast(cost.data(), classes);
      // Rounding must not let two faces swap for ever.
      if (cost[best] < cost[(*labels)[f]] - 1e-6f * (1 + all)) {
        (*labels)[f] = best;
        changed = true;
      }
    }
    if (!changed) break;
  }
}

void TakeBetter(const LabelField& field, const Adjacency& a, const std::vector<int32_t>& other,
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
      for (int64_t s = a.offsets[f]; s < a.offsets[f + 1]; ++s) {
        const uint32_t g = a.neighbour[s];
        const bool inside = other[g] != before[g];
        if (inside && g < f) continue;  // counted from the other end
        const double change = (before[f] != before[g] ? 1 : 0) - (other[f] != other[g] ? 1 : 0);
        gain += change * a.weight[s];
      }
      for (int64_t s = a.offsets[f]; s < a.offsets[f + 1]; ++s) {
        const uint32_t g = a.neighbour[s];
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

void PolishLabels(const LabelField& field, int sweeps, std::vector<int32_t>* labels) {
  Polish(field, MakeAdjacency(field), sweeps, labels);
}

void TakeBetterParts(const LabelField& field, const std::vector<int32_t>& other, std::vector<int32_t>* labels) {
  TakeBetter(field, MakeAdjacency(field), other, labels);
}

Labelling SolveLabels(const LabelField& field, const std::vector<int32_t>& start, const SolverOptions& options) {
  const int classes = field.classes;
  const size_t faces = field.faces();
  const Adjacency adjacency = MakeAdjacency(field);
  std::vector<int32_t> unary_best(faces), begin = start;
  for (size_t f = 0; f < faces; ++f) {
    unary_best[f] = IndexOfLeast(&field.unary[f * classes], classes);
    if (begin[f] < 0) begin[f] = unary_best[f];
  }

  Labelling result;
  result.beliefs = PropagateBeliefs(field, adjacency, options);
  result.labels.resize(faces);
  for (size_t f = 0; f < faces; ++f) result.labels[f] = IndexOfLeast(&result.beliefs[f * classes], classes);
  Polish(field, adjacency, options.polish_sweeps, &result.labels);
  result.start_energy = LabelEnergy(field, begin);
  for (std::vector<int32_t>* candidate : {&unary_best, &begin}) {
    Polish(field, adjacency, options.polish_sweeps, candidate);
    TakeBetter(field, adjacency, *candidate, &result.labels);
  }
  result.energy = LabelEnergy(field, result.labels);

  for (size_t f = 0; f < faces; ++f) {
    float* belief = &result.beliefs[f * classes];
    float& own = belief[result.labels[f]];
    const int32_t least = IndexOfLeast(belief, classes);
    if (least != result.labels[f]) own = belief[least] - kLead;
    const float lowest = own;
    for (int l = 0; l < classes; ++l) belief[l] -= lowest;
  }
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
