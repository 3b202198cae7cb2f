// Label cells of faces (squares of kLabelCellGsd, smaller than ground cells), and blocks of 2 x 2 label cells for block
// coordinate descent.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace tessera {

using Cell = std::array<int32_t, 2>;

// Two staggered block grids, with corners at even and at odd cells: faces at a block's border in one grid are inside
// a block in the other.
enum class BlockGrid { kEven, kOdd };

Cell BlockOf(const Cell& cell, BlockGrid grid);

// x mod 2 + 2 (y mod 2): a 4-colouring in which adjacent blocks differ.
int ColourOf(const Cell& block);

// Items grouped by cell. Groups are sorted by (y, x).
struct CellGroups {
  std::vector<Cell> cells;        // of each group, ascending
  std::vector<uint32_t> group;    // of each item
  std::vector<uint32_t> offsets;  // groups + 1
  std::vector<uint32_t> items;    // of group g from offsets[g], ascending
};
CellGroups GroupByCell(const std::vector<Cell>& cell_of_item);

}  // namespace tessera
