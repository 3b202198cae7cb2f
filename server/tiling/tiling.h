// Tiling: partitions the cells of a survey into tiles. All functions are thread-safe.
#pragma once

#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "common/job/ground.h"
#include "server/tiling/cell_index.h"
#include "server/tiling/cost_model.h"

namespace tessera {

inline constexpr int64_t kDefaultTileBytes = int64_t{4} << 30;

// Memory limit of a tile for these values of TilingOptions; the largest int64_t: none.
int64_t TileLimit_bytes(int tiles, int64_t tile_bytes);

struct TilingOptions {
  int tiles = 0;           // requested number; 0: as many as the memory limit requires
  int64_t tile_bytes = 0;  // memory limit of a tile; 0: 4 GiB, or no limit if `tiles` is set
  JobEffort effort;        // of all steps
};

// Options of a job.
TilingOptions TilingOptionsOf(const JobSettings& settings, const Survey& survey);

// Largest memory of a tile's tasks. `only`: untiled job, where one task runs all steps.
int64_t PredictTileBytes(const TileWork& work, const JobEffort& effort, bool only);

// Rectangles of cells that cover every cell of the survey exactly once, each with at least one face.
// A k-d tree over predicted work: each part is split across its longer side, or the shorter one if that balances better,
// at the cell border that balances the predicted work best, until there are `tiles` parts, or until each part with its halo is predicted to fit the memory
// limit at the upper end of the prediction interval. Gives exactly `tiles` tiles unless there are fewer cells or
// tile_bytes requires more. Depends on survey and options only, not on workers. INVALID_ARGUMENT with advice if a
// single cell does not fit.
StatusOr<std::vector<CellRect>> LayOutTiles(const CellIndex& cells, const TilingOptions& options);

// Predicted core-seconds that a cell adds to its tile, without the halo and without the exact image crops.
double PredictCellSeconds(const SurveyCell& cell, const Survey& survey, const JobEffort& effort);

}  // namespace tessera
