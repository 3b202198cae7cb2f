// The tiles over the cells of a survey.
#ifndef TESSERA_SERVER_PLAN_TILING_H_
#define TESSERA_SERVER_PLAN_TILING_H_

#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "common/job/ground.h"
#include "server/plan/cell_index.h"
#include "server/plan/cost_model.h"

namespace tessera {

inline constexpr int64_t kDefaultTileBytes = int64_t{4} << 30;

struct TilingOptions {
  int tiles = 0;           // wanted number; 0: as many as the memory asks for
  int64_t tile_bytes = 0;  // a worker's memory; 0: 4 GiB, and no limit where a number of tiles is wanted
  RefineEffort effort;     // of all steps
};

// As a job asks for.
TilingOptions TilingOptionsOf(const JobSettings& settings, const Survey& survey);

// What a tile's tasks take: memory of the hungriest. `only`: the job has no other, and one task does all steps.
int64_t PredictTileBytes(const TileWork& work, const RefineEffort& effort, bool only);

// Rectangles of cells that cover every cell of the survey exactly once, none without faces. The city is cut in two, at
// the border of cells that shares the predicted work out best, and each part again, across its longer side (a k-d
// tree), until there are `tiles` parts, or until each is predicted to fit the memory with all that it reads around it;
// predictions count with the upper end of their interval. Exactly `tiles` of them unless there are fewer cells, or
// tile_bytes asks for more. The same for the same survey and options: nothing else enters, no report of a worker, no
// number of workers. INVALID_ARGUMENT, with what to do about it, where a single cell does not fit.
StatusOr<std::vector<CellRect>> LayOutTiles(const CellIndex& cells, const TilingOptions& options);

// What a cell adds to a tile's refinement, core-seconds; without what is read around it, and without where exactly
// images are cropped.
double PredictCellSeconds(const SurveyCell& cell, const Survey& survey, const RefineEffort& effort);

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_TILING_H_
