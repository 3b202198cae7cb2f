#include "worker/label/cells.h"

#include <algorithm>
#include <numeric>
#include <unordered_map>
#include <utility>

namespace tessera {
namespace {

// Orders cells by (y, x).
uint64_t KeyOf(const Cell& cell) {
  constexpr uint32_t kSign = 1u << 31;
  return uint64_t{static_cast<uint32_t>(cell[1]) ^ kSign} << 32 | (static_cast<uint32_t>(cell[0]) ^ kSign);
}

}  // namespace

Cell BlockOf(const Cell& cell, BlockGrid grid) {
  const int64_t shift = grid == BlockGrid::kOdd;
  return {static_cast<int32_t>((cell[0] + shift) >> 1), static_cast<int32_t>((cell[1] + shift) >> 1)};
}

int ColourOf(const Cell& block, BlockGrid grid) {
  int first = block[0] & 1, second = block[1] & 1;
  if (grid == BlockGrid::kOdd) std::swap(first, second);
  return second ? 3 - first : first;
}

CellGroups GroupByCell(const std::vector<Cell>& cell_of_item) {
  CellGroups groups;
  std::vector<Cell> cells;  // in the order of their first items
  std::unordered_map<uint64_t, uint32_t> number;
  groups.group.resize(cell_of_item.size());
  for (size_t i = 0; i < cell_of_item.size(); ++i) {
    // Consecutive items mostly share a cell.
    if (i > 0 && cell_of_item[i] == cell_of_item[i - 1]) {
      groups.group[i] = groups.group[i - 1];
      continue;
    }
    const auto [at, fresh] = number.emplace(KeyOf(cell_of_item[i]), static_cast<uint32_t>(cells.size()));
    if (fresh) cells.push_back(cell_of_item[i]);
    groups.group[i] = at->second;
  }

  std::vector<uint32_t> order(cells.size()), rank(cells.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return KeyOf(cells[a]) < KeyOf(cells[b]); });
  for (uint32_t g = 0; g < order.size(); ++g) {
    rank[order[g]] = g;
    groups.cells.push_back(cells[order[g]]);
  }
  groups.offsets.assign(cells.size() + 1, 0);
  for (uint32_t& group : groups.group) {
    group = rank[group];
    ++groups.offsets[group + 1];
  }
  std::partial_sum(groups.offsets.begin(), groups.offsets.end(), groups.offsets.begin());
  std::vector<uint32_t> next(groups.offsets.begin(), groups.offsets.end() - 1);
  groups.items.resize(cell_of_item.size());
  for (uint32_t i = 0; i < cell_of_item.size(); ++i) groups.items[next[groups.group[i]]++] = i;
  return groups;
}

}  // namespace tessera
