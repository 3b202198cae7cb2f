// What a tile's pixels can depend on: which of the city's ground cells, and which part of each image.
#ifndef TESSERA_WORKER_TILE_SIGHT_H_
#define TESSERA_WORKER_TILE_SIGHT_H_

#include <cstdint>
#include <vector>

#include "common/job/ground.h"
#include "common/job/survey.h"
#include "worker/visibility/image_window.h"

namespace tessera {

struct SightOptions {
  double motion_m = 0;          // no vertex is ever farther than this from its start
  int reference_margin_px = 0;  // ReferenceMargin_px, TargetMargin_px of the job's windows and levels
  int target_margin_px = 0;
  int alignment_px = 1;  // corners of windows are multiples of it
};

struct Sight {
  std::vector<uint8_t> cells;      // of the survey: 1 for those whose faces a needed pixel may show
  std::vector<PixelRect> windows;  // of each of `views`: smallest with all needed pixels; empty: none
};

// What FindCellSight says of the core's cells, each in the views that it chose, whatever its vertices do: boxes are
// grown by the motion. `views`: indices in the survey, ascending; `core`: a flag a cell of the survey.
Sight FindSight(const Survey& survey, const std::vector<uint8_t>& core, const std::vector<int32_t>& views,
                const SightOptions& options);

}  // namespace tessera

#endif  // TESSERA_WORKER_TILE_SIGHT_H_
