// Ground cells of faces, and the blocks of two by two of them in which the solver chooses labels.
#ifndef TESSERA_WORKER_LABEL_CELLS_H_
#define TESSERA_WORKER_LABEL_CELLS_H_

#include <array>
#include <cstdint>
#include <vector>

namespace tessera {

using Cell = std::array<int32_t, 2>;

// Blocks have their corners at even cells first, at odd ones later: what borders on others in one grid is well inside
// in the other.
enum class BlockGrid { kEven, kOdd };

Cell BlockOf(const Cell& cell, BlockGrid grid);

// x mod 2 + 2 (y mod 2): blocks that touch differ.
int ColourOf(const Cell& block);

// Items that share a cell, as rows in the cells' order (rows of the ground, then along them).
struct CellGroups {
  std::vector<Cell> cells;        // of each group, ascending
  std::vector<uint32_t> group;    // of each item
  std::vector<uint32_t> offsets;  // groups + 1
  std::vector<uint32_t> items;    // of group g from offsets[g], ascending
};
CellGroups GroupByCell(const std::vector<Cell>& cell_of_item);

}  // namespace tessera

#endif  // TESSERA_WORKER_LABEL_CELLS_H_
