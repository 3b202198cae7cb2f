#include "worker/label/undecided_field.h"

#include <algorithm>
#include <utility>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 2048;

// Writes the face's costs less the weights of its edges to decided faces. Returns the total weight of its other
// edges.
float FoldDecided(const LabelField& field, const FieldGraph& graph, const std::vector<int32_t>& decided, size_t face,
                  float* cost) {
  std::copy_n(&field.unary[face * field.classes], field.classes, cost);
  float undecided = 0;
  for (const FieldLink& link : graph[face]) {
    const int32_t other = decided[link.face];
    if (other == kUndecided) {
      undecided += link.weight;
    } else {
      cost[other] -= link.weight;
    }
  }
  return undecided;
}

int32_t Decide(const float* cost, int classes, float undecided) {
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
  return second - least >= undecided ? best : kUndecided;
}

void NumberFaces(const LabelField& field, const std::vector<int32_t>& decided, UndecidedField* undecided) {
  std::vector<uint32_t> faces;
  std::vector<Cell> cells;
  for (uint32_t f = 0; f < decided.size(); ++f) {
    if (decided[f] != kUndecided) continue;
    faces.push_back(f);
    cells.push_back(field.cell.empty() ? Cell{0, 0} : field.cell[f]);
  }
  undecided->number.assign(decided.size(), UndecidedField::kNone);
  for (const uint32_t item : GroupByCell(cells).items) {
    undecided->number[faces[item]] = static_cast<uint32_t>(undecided->faces.size());
    undecided->faces.push_back(faces[item]);
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
        const float undecided = FoldDecided(field, graph, decided, f, cost.data());
        next[f] = Decide(cost.data(), field.classes, undecided);
      }
    });
    decided = next;
  }
  return decided;
}

UndecidedField MakeUndecidedField(const LabelField& field, const FieldGraph& graph,
                                  const std::vector<int32_t>& decided) {
  UndecidedField undecided;
  undecided.classes = field.classes;
  undecided.lanes = (field.classes + UndecidedField::kLanes - 1) / UndecidedField::kLanes * UndecidedField::kLanes;
  NumberFaces(field, decided, &undecided);
  undecided.cost.resize(undecided.size() * undecided.lanes);
  ParallelForEach(undecided.size(), kGrain, [&](int64_t i) {
    float* cost = &undecided.cost[i * undecided.lanes];
    std::fill_n(cost, undecided.lanes, UndecidedField::kNever);
    FoldDecided(field, graph, decided, undecided.faces[i], cost);
  });

  undecided.offsets.assign(1, 0);
  undecided.offsets.reserve(undecided.size() + 1);
  undecided.links.reserve(3 * undecided.size());
  std::vector<uint32_t> first_end(field.edges.size(), UndecidedField::kNone);
  for (const uint32_t f : undecided.faces) {
    for (const FieldLink& link : graph[f]) {
      if (undecided.number[link.face] == UndecidedField::kNone) continue;
      const uint32_t here = static_cast<uint32_t>(undecided.links.size());
      uint32_t& there = first_end[link.edge];
      undecided.links.push_back({undecided.number[link.face], there, link.weight});
      if (there == UndecidedField::kNone) {
        there = here;
      } else {
        undecided.links[there].reverse = here;
      }
    }
    undecided.offsets.push_back(static_cast<uint32_t>(undecided.links.size()));
  }
  return undecided;
}

Blocks MakeBlocks(const LabelField& field, const UndecidedField& undecided, BlockGrid grid) {
  std::vector<uint32_t> numbers;  // in the order of the field's faces
  std::vector<Cell> cells;
  numbers.reserve(undecided.size());
  cells.reserve(undecided.size());
  for (size_t f = 0; f < undecided.number.size(); ++f) {
    if (undecided.number[f] == UndecidedField::kNone) continue;
    numbers.push_back(undecided.number[f]);
    cells.push_back(field.cell.empty() ? Cell{0, 0} : BlockOf(field.cell[f], grid));
  }
  CellGroups groups = GroupByCell(cells);

  Blocks blocks;
  blocks.offsets = std::move(groups.offsets);
  blocks.faces = std::move(groups.items);
  std::vector<int> colour(groups.cells.size());
  for (uint32_t b = 0; b < groups.cells.size(); ++b) {
    colour[b] = ColourOf(groups.cells[b], grid);
    blocks.colours[colour[b]].push_back(b);
  }
  blocks.block.resize(numbers.size());
  blocks.index_in_block.resize(numbers.size());
  for (uint32_t b = 0; b < blocks.size(); ++b) {
    for (uint32_t i = blocks.offsets[b]; i < blocks.offsets[b + 1]; ++i) {
      const uint32_t number = numbers[blocks.faces[i]];
      blocks.faces[i] = number;
      blocks.block[number] = b;
      blocks.index_in_block[number] = i - blocks.offsets[b];
    }
  }
  blocks.bridge.assign(numbers.size(), 0);
  for (size_t f = 0; f < numbers.size(); ++f) {
    const uint32_t here = blocks.block[f];
    for (const UndecidedField::Link& link : undecided[f]) {
      const uint32_t there = blocks.block[link.face];
      if (there != here && colour[there] == colour[here]) blocks.bridge[f] = 1;
    }
  }
  return blocks;
}

}  // namespace tessera
