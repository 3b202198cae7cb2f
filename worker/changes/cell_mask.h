// Sets of cells of a raster: morphological filters and connected components.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace tessera {

// One flag per cell, row-major.
struct CellMask {
  int width = 0, height = 0;
  std::vector<uint8_t> flag;

  CellMask() = default;
  CellMask(int w, int h) : width(w), height(h), flag(static_cast<size_t>(w) * h, 0) {}
};

// 3 x 3 majority filter; cells outside the mask count as unset.
CellMask Majority(const CellMask& mask);

// Removes narrow parts: keeps set cells that lie in, or touch, a square of side x side set cells.
CellMask WithoutSlivers(const CellMask& mask, int side);

// Connected components of `mask` (4-neighbourhood) that contain a cell of `seeds`, as ascending cell indices.
// Components are ordered by their first cell.
std::vector<std::vector<size_t>> ConnectedParts(const CellMask& mask, const CellMask& seeds);

}  // namespace tessera
