// All steps of a job's only tile, in memory.
#pragma once

#include <cstdint>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "worker/tile/methods.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {

struct TileRefinement {
  TileState state;
  int64_t left_faces = 0;  // CoreRepair, all repairs together
  double seconds_loading = 0, seconds_visibility = 0, seconds_data = 0, seconds_step = 0, seconds_repair = 0,
         seconds_labels = 0;
};

// Measure, Solve and Repair over `steps`, active steps of the job (ActiveTileSteps). Gives the same bytes as the tasks
// of several tiles. `start`: the repaired state before these steps; null: the package's mesh. `to_end`: the job's last
// step is among them, after which the fit is measured. INVALID_ARGUMENT unless work.whole(). CANCELLED follows
// `control`.
StatusOr<TileRefinement> RefineTile(TileWorkspace& work, TileImages& images, const std::vector<TileStep>& steps,
                                    const TileRefineOptions& options, const MappedState* start, bool to_end,
                                    const TaskControl& control, const Clock& clock);

}  // namespace tessera
