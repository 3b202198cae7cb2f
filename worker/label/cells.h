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

inline constexpr int kColours = 4;

// A colouring in which blocks that share a side or corner differ. Blocks change in the order of their colours, so a
// block depends on neighbours of earlier colours, on neighbours of these, and so on. The order keeps such chains short:
// of (x mod 2, y mod 2), 00, 10, 11, 01 for even blocks, which reaches two blocks in x and one in y; with x and y
// exchanged for odd blocks.
int ColourOf(const Cell& block, BlockGrid grid);

// Items grouped by cell. Groups are sorted by (y, x).
struct CellGroups {
  std::vector<Cell> cells;        // of each group, ascending
  std::vector<uint32_t> group;    // of each item
  std::vector<uint32_t> offsets;  // groups + 1
  std::vector<uint32_t> items;    // of group g from offsets[g], ascending
};
CellGroups GroupByCell(const std::vector<Cell>& cell_of_item);

}  // namespace tessera
