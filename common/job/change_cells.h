// The grid of cells in which changes between flights are measured. Plan and tasks use the same grid.
#pragma once

#include <cmath>

namespace tessera {

// Side of a cell in metres: the power of two nearest to 3.5 GSD, so that the cells of all tiles and of the survey
// coincide.
inline double ChangeCellSize_m(double gsd_m) { return std::exp2(std::round(std::log2(3.5 * gsd_m))); }

// Blocks are squares of kBlockCells x kBlockCells cells; their corners are multiples of kBlockCells. The result of a
// block depends only on the surface within kBlockMargin cells of it and on the views that see it.
inline constexpr int kBlockCells = 96;
inline constexpr int kBlockMargin = 14;

}  // namespace tessera
