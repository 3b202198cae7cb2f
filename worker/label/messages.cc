#include "worker/label/messages.h"

#include <algorithm>
#include <cstdint>
#include <cstring>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 2048;
constexpr int kLanes = UndecidedField::kLanes;
typedef float Vec __attribute__((vector_size(kLanes * sizeof(float))));

Vec Load(const float* from) {
  Vec v;
  std::memcpy(&v, from, sizeof v);
  return v;
}

void Store(Vec v, float* to) { std::memcpy(to, &v, sizeof v); }

Vec Min(Vec a, Vec b) { return a < b ? a : b; }

// Minimum over the lanes, in all lanes.
Vec MinOfLanes(Vec v) {
  v = Min(v, __builtin_shufflevector(v, v, 2, 3, 0, 1));
  return Min(v, __builtin_shufflevector(v, v, 1, 0, 3, 2));
}

// Updates the messages to faces [begin, end) and their beliefs from those of the previous iteration. kVectors:
// vectors per face as a compile-time constant, 0 if only known at run time.
template <int kVectors>
void UpdateMessages(const UndecidedField& undecided, int64_t begin, int64_t end, float fresh, const Messages& from,
                    Messages* to) {
  const size_t lanes = kVectors > 0 ? kVectors * kLanes : undecided.lanes;
  const int vectors = static_cast<int>(lanes) / kLanes;
  const float* message = from.incoming.data();
  const float* belief = from.beliefs.data();
  float* __restrict next_message = to->incoming.data();
  float* __restrict next_belief = to->beliefs.data();
  for (int64_t i = begin; i < end; ++i) {
    float* sum = next_belief + i * lanes;
    for (int v = 0; v < vectors; ++v) Store(Load(&undecided.cost[i * lanes + v * kLanes]), sum + v * kLanes);
    for (uint32_t s = undecided.offsets[i]; s < undecided.offsets[i + 1]; ++s) {
      const UndecidedField::Link link = undecided.links[s];
      // The neighbour's belief without the message from this face.
      const float* theirs = belief + link.face * lanes;
      const float* mine = message + link.reverse * lanes;
      const auto sent = [&](int v) { return Load(theirs + v * kLanes) - Load(mine + v * kLanes); };
      Vec least = sent(0);
      for (int v = 1; v < vectors; ++v) least = Min(least, sent(v));
      least = MinOfLanes(least);
      const Vec weight = Vec{} + link.weight;
      for (int v = 0; v < vectors; ++v) {
        const Vec potts = Min(sent(v) - least, weight);
        const Vec old = Load(message + s * lanes + v * kLanes);
        const Vec now = old + fresh * (potts - old);
        Store(now, next_message + s * lanes + v * kLanes);
        Store(Load(sum + v * kLanes) + now, sum + v * kLanes);
      }
    }
  }
}

// Belief of a decided face. An undecided neighbour sends its belief without this face's own message. A decided
// neighbour does the same with `decided_beliefs`, or sends its constant message if that is null. `sent`: buffer for
// one message.
void DecidedBelief(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& decided,
                   const UndecidedField& undecided, const Messages& messages, const float* decided_beliefs, size_t face,
                   float* sent, float* belief) {
  const int classes = field.classes;
  std::copy_n(&field.unary[face * classes], classes, belief);
  for (const FieldLink& link : graph[face]) {
    const int32_t other = decided[link.face];
    if (other != kUndecided && decided_beliefs == nullptr) {
      for (int l = 0; l < classes; ++l) belief[l] += l == other ? 0 : link.weight;
      continue;
    }
    const float* theirs = other != kUndecided ? decided_beliefs + static_cast<size_t>(link.face) * classes
                                              : &messages.beliefs[undecided.number[link.face] * undecided.lanes];
    std::copy_n(theirs, classes, sent);
    // The decided message from here costs the weight for every label but one. Up to a constant:
    sent[decided[face]] += link.weight;
    const float least = *std::min_element(sent, sent + classes);
    for (int l = 0; l < classes; ++l) belief[l] += std::min(sent[l] - least, link.weight);
  }
}

}  // namespace

Messages InitialMessages(const UndecidedField& undecided) {
  return {std::vector<float>(undecided.links.size() * undecided.lanes, 0.0f), undecided.cost};
}

void PassMessages(const UndecidedField& undecided, int iterations, double damping, Messages* messages) {
  const float fresh = static_cast<float>(1 - damping);
  const auto update = undecided.lanes == kLanes       ? UpdateMessages<1>
                      : undecided.lanes == 2 * kLanes ? UpdateMessages<2>
                                                      : UpdateMessages<0>;
  Messages next{std::vector<float>(messages->incoming.size()), std::vector<float>(messages->beliefs.size())};
  for (int iteration = 0; iteration < iterations; ++iteration) {
    ParallelFor(static_cast<int64_t>(undecided.size()), kGrain,
                [&](int64_t begin, int64_t end) { update(undecided, begin, end, fresh, *messages, &next); });
    std::swap(*messages, next);
  }
}

std::vector<float> FaceBeliefs(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& decided,
                               const UndecidedField& undecided, const Messages& messages) {
  const int classes = field.classes;
  std::vector<float> beliefs(field.unary.size()), first;
  for (const bool again : {false, true}) {
    // Repeat once: messages between decided faces may depend on the other messages that these receive.
    if (again) first = beliefs;
    ParallelFor(static_cast<int64_t>(decided.size()), kGrain, [&](int64_t begin, int64_t end) {
      std::vector<float> sent(classes);
      for (int64_t f = begin; f < end; ++f) {
        float* belief = &beliefs[f * classes];
        if (decided[f] != kUndecided) {
          DecidedBelief(field, graph, decided, undecided, messages, again ? first.data() : nullptr, f, sent.data(),
                        belief);
        } else if (!again) {
          std::copy_n(&messages.beliefs[undecided.number[f] * undecided.lanes], classes, belief);
        }
      }
    });
  }
  return beliefs;
}

}  // namespace tessera
