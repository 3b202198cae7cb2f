// The cells that changes are measured in: those of all tiles, of the plan and of the tasks.
#ifndef TESSERA_COMMON_JOB_CHANGE_CELLS_H_
#define TESSERA_COMMON_JOB_CHANGE_CELLS_H_

#include <cmath>

namespace tessera {

// Side of a cell: the power of two nearest to 3.5 GSD, so that cells of all tiles and of the survey's ground coincide.
inline double ChangeCellSize_m(double gsd_m) { return std::exp2(std::round(std::log2(3.5 * gsd_m))); }

// Blocks are squares of so many cells whose corners are multiples of it. What is measured in a block depends on the
// surface within kBlockMargin cells of it and on the views that see it alone.
inline constexpr int kBlockCells = 96;
inline constexpr int kBlockMargin = 14;

}  // namespace tessera

#endif  // TESSERA_COMMON_JOB_CHANGE_CELLS_H_
