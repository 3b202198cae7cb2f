// A step of a tile's refinement with its position in its level.
#pragma once

#include <vector>

#include "common/job/refine_steps.h"
#include "worker/tile/tile_files.h"

namespace tessera {

struct TileStep {
  RefineStep step;
  int level_iteration = 0;  // counted from 0 in the level and round
  bool finest = false;      // an iteration of the finest level: the report has its energy

  bool labels() const { return step.labels(); }
  // The region whose faces Solve reads.
  Region region() const { return labels() ? kLabelRegion : kSolveRegion; }
};

// One for each of `steps`, all those of a job.
std::vector<TileStep> TileStepsOf(const std::vector<RefineStep>& steps);

}  // namespace tessera
