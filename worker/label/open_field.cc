#include "worker/label/open_field.h"

#include <algorithm>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 2048;
constexpr int kDecideRounds = 4;

// The face's costs, less the weight of its edges to decided faces of a class; returns what its other edges weigh.
float FoldDecided(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& decided, size_t face,
                  float* cost) {
  std::copy_n(&field.unary[face * field.classes], field.classes, cost);
  float open = 0;
  for (const FieldLink& link : graph[face]) {
    const int32_t other = decided[link.face];
    if (other == kUndecided) {
      open += link.weight;
    } else {
      cost[other] -= link.weight;
    }
  }
  return open;
}

int32_t Decide(const float* cost, int classes, float open) {
  float least = std::numeric_limits<float>::infinity(), second = least;
  int32_t best = 0;
  for (int l = 0; l < classes; ++l) {
    if (cost[l] < least) {
      second = least;
      least = cost[l];
      best = l;
    } else {
      second = std::min(second, cost[l]);
    }
  }
  return second - least >= open ? best : kUndecided;
}

// Numbers the undecided faces breadth first.
void NumberFaces(const FieldGraph& graph, const std::vector<int32_t>& decided, OpenField* open) {
  open->number.assign(decided.size(), OpenField::kNone);
  const auto enter = [&](uint32_t face) {
    if (decided[face] != kUndecided || open->number[face] != OpenField::kNone) return;
    open->number[face] = static_cast<uint32_t>(open->faces.size());
    open->faces.push_back(face);
  };
  size_t done = 0;
  for (uint32_t start = 0; start < decided.size(); ++start) {
    enter(start);
    for (; done < open->faces.size(); ++done) {
      for (const FieldLink& link : graph[open->faces[done]]) enter(link.face);
    }
  }
}

}  // namespace

std::vector<int32_t> DecideFaces(const LabelField& field, const FieldGraph& graph) {
  std::vector<int32_t> decided(field.faces(), kUndecided), next = decided;
  for (int round = 0; round < kDecideRounds; ++round) {
    ParallelFor(static_cast<int64_t>(decided.size()), kGrain, [&](int64_t begin, int64_t end) {
      std::vector<float> cost(field.classes);
      for (int64_t f = begin; f < end; ++f) {
        if (decided[f] != kUndecided) continue;
        const float open = FoldDecided(field, graph, decided, f, cost.data());
        next[f] = Decide(cost.data(), field.classes, open);
      }
    });
    decided = next;
  }
  return decided;
}

OpenField MakeOpenField(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& decided) {
  OpenField open;
  open.classes = field.classes;
  open.lanes = (field.classes + OpenField::kLanes - 1) / OpenField::kLanes * OpenField::kLanes;
  NumberFaces(graph, decided, &open);
  open.cost.resize(open.size() * open.lanes);
  ParallelFor(static_cast<int64_t>(open.size()), kGrain, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      float* cost = &open.cost[i * open.lanes];
      std::fill_n(cost, open.lanes, OpenField::kNever);
      FoldDecided(field, graph, decided, open.faces[i], cost);
    }
  });

  open.offsets.assign(1, 0);
  open.offsets.reserve(open.size() + 1);
  open.links.reserve(3 * open.size());
  std::vector<uint32_t> first_end(field.edges.size(), OpenField::kNone);
  for (const uint32_t f : open.faces) {
    for (const FieldLink& link : graph[f]) {
      if (open.number[link.face] == OpenField::kNone) continue;
      const uint32_t here = static_cast<uint32_t>(open.links.size());
      uint32_t& there = first_end[link.edge];
      open.links.push_back({open.number[link.face], there, link.weight});
      if (there == OpenField::kNone) {
        there = here;
      } else {
        open.links[there].reverse = here;
      }
    }
    open.offsets.push_back(static_cast<uint32_t>(open.links.size()));
  }
  return open;
}

}  // namespace tessera
