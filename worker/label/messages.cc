#include "worker/label/messages.h"

#include <algorithm>
#include <cstdint>
#include <cstring>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 2048;
constexpr int kLanes = OpenField::kLanes;
typedef float Vec __attribute__((vector_size(kLanes * sizeof(float))));

Vec Load(const float* from) {
  Vec v;
  std::memcpy(&v, from, sizeof v);
  return v;
}

void Store(Vec v, float* to) { std::memcpy(to, &v, sizeof v); }

Vec Min(Vec a, Vec b) { return a < b ? a : b; }

// The least lane, in all of them.
Vec MinOfLanes(Vec v) {
  v = Min(v, __builtin_shufflevector(v, v, 2, 3, 0, 1));
  return Min(v, __builtin_shufflevector(v, v, 1, 0, 3, 2));
}

// Faces begin to end read what was said and believed in `from` and write what they hear and believe now. kVectors: of
// a face, 0 where the compiler does not know.
template <int kVectors>
void Listen(const OpenField& open, int64_t begin, int64_t end, float fresh, const Messages& from, Messages* to) {
  const size_t lanes = kVectors > 0 ? kVectors * kLanes : open.lanes;
  const int vectors = static_cast<int>(lanes) / kLanes;
  const float* message = from.incoming.data();
  const float* belief = from.beliefs.data();
  float* __restrict next_message = to->incoming.data();
  float* __restrict next_belief = to->beliefs.data();
  for (int64_t i = begin; i < end; ++i) {
    float* sum = next_belief + i * lanes;
    for (int v = 0; v < vectors; ++v) Store(Load(&open.cost[i * lanes + v * kLanes]), sum + v * kLanes);
    for (uint32_t s = open.offsets[i]; s < open.offsets[i + 1]; ++s) {
      const OpenField::Link link = open.links[s];
      // What the neighbour believes without what it heard from here.
      const float* theirs = belief + link.face * lanes;
      const float* mine = message + link.reverse * lanes;
      const auto said = [&](int v) { return Load(theirs + v * kLanes) - Load(mine + v * kLanes); };
      Vec least = said(0);
      for (int v = 1; v < vectors; ++v) least = Min(least, said(v));
      least = MinOfLanes(least);
      const Vec weight = Vec{} + link.weight;
      for (int v = 0; v < vectors; ++v) {
        const Vec potts = Min(said(v) - least, weight);
        const Vec old = Load(message + s * lanes + v * kLanes);
        const Vec now = old + fresh * (potts - old);
        Store(now, next_message + s * lanes + v * kLanes);
        Store(Load(sum + v * kLanes) + now, sum + v * kLanes);
      }
    }
  }
}

// Belief of a decided face. Through links to open faces it hears what they believe without what they heard from it;
// to decided ones, the same by `decided_beliefs`, or their decided message where that is null.
void HearAll(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& decided,
             const OpenField& open, const Messages& messages, const float* decided_beliefs, size_t face, float* heard,
             float* belief) {
  const int classes = field.classes;
  std::copy_n(&field.unary[face * classes], classes, belief);
  for (const FieldLink& link : graph[face]) {
    const int32_t other = decided[link.face];
    if (other != kUndecided && decided_beliefs == nullptr) {
      for (int l = 0; l < classes; ++l) belief[l] += l == other ? 0 : link.weight;
      continue;
    }
    const float* theirs = other != kUndecided ? decided_beliefs + static_cast<size_t>(link.face) * classes
                                              : &messages.beliefs[open.number[link.face] * open.lanes];
    std::copy_n(theirs, classes, heard);
    // The decided message from here counts the weight for every label but one; up to a constant:
    heard[decided[face]] += link.weight;
    const float least = *std::min_element(heard, heard + classes);
    for (int l = 0; l < classes; ++l) belief[l] += std::min(heard[l] - least, link.weight);
  }
}

}  // namespace

Messages NoMessages(const OpenField& open) {
  return {std::vector<float>(open.links.size() * open.lanes, 0.0f), open.cost};
}

void PassMessages(const OpenField& open, int iterations, double damping, Messages* messages) {
  const float fresh = static_cast<float>(1 - damping);
  const auto listen = open.lanes == kLanes ? Listen<1> : open.lanes == 2 * kLanes ? Listen<2> : Listen<0>;
  Messages next{std::vector<float>(messages->incoming.size()), std::vector<float>(messages->beliefs.size())};
  for (int iteration = 0; iteration < iterations; ++iteration) {
    ParallelFor(static_cast<int64_t>(open.size()), kGrain,
                [&](int64_t begin, int64_t end) { listen(open, begin, end, fresh, *messages, &next); });
    std::swap(*messages, next);
  }
}

std::vector<float> AllBeliefs(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& decided,
                              const OpenField& open, const Messages& messages) {
  const int classes = field.classes;
  std::vector<float> beliefs(field.unary.size()), first;
  for (const bool again : {false, true}) {
    // Again, since what decided faces tell each other may depend on what they hear.
    if (again) first = beliefs;
    ParallelFor(static_cast<int64_t>(decided.size()), kGrain, [&](int64_t begin, int64_t end) {
      std::vector<float> heard(classes);
      for (int64_t f = begin; f < end; ++f) {
        float* belief = &beliefs[f * classes];
        if (decided[f] != kUndecided) {
          HearAll(field, graph, decided, open, messages, again ? first.data() : nullptr, f, heard.data(), belief);
        } else if (!again) {
          std::copy_n(&messages.beliefs[open.number[f] * open.lanes], classes, belief);
        }
      }
    });
  }
  return beliefs;
}

}  // namespace tessera
