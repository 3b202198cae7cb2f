// All steps of a job's only tile, in memory.
#pragma once

#include <cstdint>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_options.h"
#include "worker/tile/tile_step.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {

// One iteration of the geometry.
struct IterationReport {
  int level = 0;
  double energy = -1, semantic_energy = -1;  // before the step, as StepSums has them
  double moved_px = 0;                       // RMS of the step, pixels of the level
  int64_t windows = 0;                       // accepted ones
};

struct TileRefinement {
  TileState state;
  std::vector<IterationReport> iterations;
  int64_t left_faces = 0, repaired_vertices = 0;  // CoreRepair, all repairs together
  int64_t warped_pixels = 0;                      // reference pixels x partners x evaluations
  double seconds_loading = 0, seconds_visibility = 0, seconds_data = 0, seconds_step = 0, seconds_repair = 0,
         seconds_labels = 0;
};

// Measure, Solve and Repair over `steps`, those of the job that act: the bytes that the same functions give as tasks of
// several tiles. `work` must be whole. CANCELLED follows `control`.
StatusOr<TileRefinement> RefineTile(TileWorkspace& work, TileImages& images, const std::vector<TileStep>& steps,
                                    const TileRefineOptions& options, const TaskControl& control, const Clock& clock);

}  // namespace tessera
