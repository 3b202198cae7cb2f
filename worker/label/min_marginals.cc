#include "worker/label/min_marginals.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>

#include "common/base/parallel.h"

namespace tessera {
namespace {

// Four lanes are what every machine has, and as many classes as a city mostly has.
constexpr int kLanes = 4;
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

constexpr int64_t kGrain = 2048;
constexpr int kDecideRounds = 4;
constexpr int32_t kUndecided = -1;
constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
constexpr float kNever = 1e30f;  // cost of the lanes that stand for no class

// How many vectors a face's costs take: known to the compiler (kVectors > 0) or not.
template <int kVectors>
struct Stride {
  explicit Stride(int) {}
  static constexpr int vectors = kVectors;
};
template <>
struct Stride<0> {
  explicit Stride(int count) : vectors(count) {}
  int vectors;
};

// Faces that others wait for, with their links among each other; numbered so that neighbours are near in memory.
// Nothing that is computed depends on the numbering: every sum runs over a face's links in the field's order.
struct OpenFaces {
  std::vector<uint32_t> faces;     // number -> face
  std::vector<uint32_t> number;    // face -> number, or kNone
  std::vector<uint32_t> offsets;   // faces + 1
  std::vector<uint32_t> neighbour, reverse;  // a link's other end: its face, and the same edge's link there
  std::vector<float> weight;
};

// Messages m to a face of cost differences in [0, weight], so a face whose cost leads by no less than all its edges
// weigh sends (0 for its label, the weight for others) to each of them, always. Such messages are added to the costs of
// those who get them, which decides more. A fixed number of rounds, so that only the surroundings count.
class Decisions {
 public:
  Decisions(const LabelField& field, const FieldGraph& graph)
      : field_(field), graph_(graph), label_(field.faces(), kUndecided) {
    std::vector<int32_t> next(label_.size(), kUndecided);
    for (int round = 0; round < kDecideRounds; ++round) {
      ParallelFor(static_cast<int64_t>(label_.size()), kGrain, [&](int64_t begin, int64_t end) {
        std::vector<float> cost(field_.classes);
        for (int64_t f = begin; f < end; ++f) {
          if (next[f] == kUndecided) next[f] = Decide(f, cost.data());
        }
      });
      label_ = next;
    }
  }

  int32_t label(size_t face) const { return label_[face]; }

 private:
  int32_t Decide(int64_t face, float* cost) const {
    const int classes = field_.classes;
    std::copy_n(&field_.unary[face * classes], classes, cost);
    float open = 0;
    for (const FieldLink& link : graph_[face]) {
      const int32_t other = label_[link.face];
      if (other == kUndecided) {
        open += link.weight;
      } else {
        cost[other] -= link.weight;
      }
    }
    float least = std::numeric_limits<float>::infinity(), second = least;
    int32_t best = 0;
    for (int l = 0; l < classes; ++l) {
      if (cost[l] < least) {
        second = least;
        least = cost[l];
        best = l;
      } else if (cost[l] < second) {
        second = cost[l];
      }
    }
    return second - least >= open ? best : kUndecided;
  }

  const LabelField& field_;
  const FieldGraph& graph_;
  std::vector<int32_t> label_;
};

OpenFaces MakeOpenFaces(const LabelField& field, const FieldGraph& graph, const Decisions& decisions) {
  OpenFaces open;
  open.number.assign(field.faces(), kNone);
  for (size_t f = 0; f < field.faces(); ++f) {
    if (decisions.label(f) != kUndecided || open.number[f] != kNone) continue;
    size_t done = open.faces.size();
    open.number[f] = static_cast<uint32_t>(done);
    open.faces.push_back(static_cast<uint32_t>(f));
    for (; done < open.faces.size(); ++done) {
      for (const FieldLink& link : graph[open.faces[done]]) {
        if (decisions.label(link.face) != kUndecided || open.number[link.face] != kNone) continue;
        open.number[link.face] = static_cast<uint32_t>(open.faces.size());
        open.faces.push_back(link.face);
      }
    }
  }
  open.offsets.assign(1, 0);
  open.offsets.reserve(open.faces.size() + 1);
  std::vector<uint32_t> first_end(field.edges.size(), kNone);
  for (const uint32_t f : open.faces) {
    for (const FieldLink& link : graph[f]) {
      if (open.number[link.face] == kNone) continue;
      const uint32_t here = static_cast<uint32_t>(open.neighbour.size());
      uint32_t& there = first_end[link.edge];
      open.neighbour.push_back(open.number[link.face]);
      open.weight.push_back(link.weight);
      open.reverse.push_back(there);
      if (there == kNone) {
        there = here;
      } else {
        open.reverse[there] = here;
      }
    }
    open.offsets.push_back(static_cast<uint32_t>(open.neighbour.size()));
  }
  return open;
}

template <int kVectors>
class Propagation {
 public:
  Propagation(const LabelField& field, const FieldGraph& graph)
      : field_(field), graph_(graph), stride_((field.classes + kLanes - 1) / kLanes), decisions_(field, graph) {}

  std::vector<float> Run(int iterations, float damping) {
    const OpenFaces open = MakeOpenFaces(field_, graph_, decisions_);
    std::vector<float> belief = OpenBeliefs(open, iterations, damping);
    std::vector<float> all(field_.faces() * lanes());
    ForFaces([&](int64_t f, float*) {
      if (decisions_.label(f) == kUndecided) {
        std::copy_n(&belief[static_cast<size_t>(open.number[f]) * lanes()], lanes(), &all[f * lanes()]);
      } else {
        FoldDecided(f, &all[f * lanes()]);
      }
    });
    belief = all;
    // What decided faces hear from others: twice, for what they tell each other may depend on what they are told.
    for (int round = 0; round < 2; ++round) {
      ForFaces([&](int64_t f, float* scratch) {
        if (decisions_.label(f) != kUndecided) Listen(f, all, scratch, &belief[f * lanes()]);
      });
      all = belief;
    }
    std::vector<float> beliefs(field_.unary.size());
    ForFaces([&](int64_t f, float*) {
      std::copy_n(&belief[f * lanes()], field_.classes, &beliefs[f * field_.classes]);
    });
    return beliefs;
  }

 private:
  int lanes() const { return stride_.vectors * kLanes; }

  // body(face, scratch of one face's costs)
  template <typename Body>
  void ForFaces(const Body& body) const {
    ParallelFor(static_cast<int64_t>(field_.faces()), kGrain, [&](int64_t begin, int64_t end) {
      std::vector<float> scratch(lanes());
      for (int64_t f = begin; f < end; ++f) body(f, scratch.data());
    });
  }

  // Own costs and the messages of decided neighbours, up to a constant.
  void FoldDecided(int64_t face, float* cost) const {
    std::fill_n(cost, lanes(), kNever);
    std::copy_n(&field_.unary[face * field_.classes], field_.classes, cost);
    for (const FieldLink& link : graph_[face]) {
      const int32_t other = decisions_.label(link.face);
      if (other != kUndecided) cost[other] -= link.weight;
    }
  }

  // Belief of a decided face when its neighbours' are `all`, which hold its decided message.
  void Listen(int64_t face, const std::vector<float>& all, float* scratch, float* belief) const {
    const int32_t label = decisions_.label(face);
    std::fill_n(belief, lanes(), kNever);
    std::copy_n(&field_.unary[face * field_.classes], field_.classes, belief);
    for (const FieldLink& link : graph_[face]) {
      std::copy_n(&all[static_cast<size_t>(link.face) * lanes()], lanes(), scratch);
      scratch[label] += link.weight;
      const float least = *std::min_element(scratch, scratch + field_.classes);
      for (int l = 0; l < field_.classes; ++l) belief[l] += std::min(scratch[l] - least, link.weight);
    }
  }

  // Every round reads the messages and beliefs of the one before and writes each face's own.
  std::vector<float> OpenBeliefs(const OpenFaces& open, int iterations, float damping) const {
    const int64_t count = static_cast<int64_t>(open.faces.size());
    std::vector<float> cost(count * lanes()), belief, next_belief(cost.size());
    ParallelFor(count, kGrain, [&](int64_t begin, int64_t end) {
      for (int64_t i = begin; i < end; ++i) FoldDecided(open.faces[i], &cost[i * lanes()]);
    });
    belief = cost;
    std::vector<float> message(open.neighbour.size() * lanes(), 0.0f), next_message(message.size());
    for (int iteration = 0; iteration < iterations; ++iteration) {
      ParallelFor(count, kGrain, [&](int64_t begin, int64_t end) {
        Exchange(open, begin, end, 1 - damping, cost.data(), belief.data(), message.data(), next_belief.data(),
                 next_message.data());
      });
      belief.swap(next_belief);
      message.swap(next_message);
    }
    return belief;
  }

  void Exchange(const OpenFaces& open, int64_t begin, int64_t end, float fresh, const float* cost, const float* belief,
                const float* message, float* __restrict next_belief, float* __restrict next_message) const {
    const int vectors = stride_.vectors;
    const size_t size = lanes();
    for (int64_t i = begin; i < end; ++i) {
      float* sum = next_belief + i * size;
      for (int v = 0; v < vectors; ++v) Store(Load(cost + i * size + v * kLanes), sum + v * kLanes);
      for (uint32_t s = open.offsets[i]; s < open.offsets[i + 1]; ++s) {
        // What the neighbour believes without what it had from here.
        const float* theirs = belief + open.neighbour[s] * size;
        const float* mine = message + open.reverse[s] * size;
        const auto said = [&](int v) { return Load(theirs + v * kLanes) - Load(mine + v * kLanes); };
        Vec least = said(0);
        for (int v = 1; v < vectors; ++v) least = Min(least, said(v));
        least = MinOfLanes(least);
        const Vec weight = Vec{} + open.weight[s];
        for (int v = 0; v < vectors; ++v) {
          const Vec potts = Min(said(v) - least, weight);
          const Vec old = Load(message + s * size + v * kLanes);
          const Vec now = old + fresh * (potts - old);
          Store(now, next_message + s * size + v * kLanes);
          Store(Load(sum + v * kLanes) + now, sum + v * kLanes);
        }
      }
    }
  }

  const LabelField& field_;
  const FieldGraph& graph_;
  const Stride<kVectors> stride_;
  const Decisions decisions_;
};

}  // namespace

std::vector<float> MinMarginals(const LabelField& field, const FieldGraph& graph, int iterations, double damping) {
  const float keep = static_cast<float>(damping);
  if (field.classes <= kLanes) return Propagation<1>(field, graph).Run(iterations, keep);
  if (field.classes <= 2 * kLanes) return Propagation<2>(field, graph).Run(iterations, keep);
  return Propagation<0>(field, graph).Run(iterations, keep);
}

}  // namespace tessera
