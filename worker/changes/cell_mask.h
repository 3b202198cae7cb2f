// Sets of cells of a raster: clean-up and connected parts.
#ifndef TESSERA_WORKER_CHANGES_CELL_MASK_H_
#define TESSERA_WORKER_CHANGES_CELL_MASK_H_

#include <cstddef>
#include <cstdint>
#include <vector>

namespace tessera {

// One flag a cell, row by row.
struct CellMask {
  int width = 0, height = 0;
  std::vector<uint8_t> flag;

  CellMask() = default;
  CellMask(int w, int h) : width(w), height(h), flag(static_cast<size_t>(w) * h, 0) {}
};

// A cell becomes what most of its 3 x 3 cells are; outside nothing is set.
CellMask Majority(const CellMask& mask);

// Cells that some square of side x side set cells holds, and set cells that touch one of those.
CellMask WithoutSlivers(const CellMask& mask, int side);

// Parts of `mask` connected by cells' sides that hold a cell of `seeds`, each as indices of its cells, ascending; parts
// by their first cell.
std::vector<std::vector<size_t>> ConnectedParts(const CellMask& mask, const CellMask& seeds);

}  // namespace tessera

#endif  // TESSERA_WORKER_CHANGES_CELL_MASK_H_
