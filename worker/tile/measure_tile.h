// What the pixels show of each face of a tile in one step.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "worker/label/unary.h"
#include "worker/photo/data_term.h"
#include "worker/tile/methods.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {

// The sums of one step, an entry a face: of the package's faces (Measure) or of those that Solve reads (AssembleSums).
struct StepSums {
  FaceDerivatives derivatives;           // of an iteration
  FaceLikelihoods likelihoods = {0, 0};  // of a label step
  // Means over the windows and pixels of the tile itself; -1: none.
  double energy = -1, semantic_energy = -1;
  int64_t warped_pixels = 0;
  double seconds_loading = 0;  // until the pixels of the level were at hand
  std::string fit;             // of the last step of a job that moved vertices: ToJson of its TileFit; else empty
};

// Evaluates the data term (iterations) or sums up likelihoods (label steps) at the positions and labels of `snapshot`.
// Right for the faces of work.measured(). Iterations leave the derivatives unchanged and the energies at -1 unless
// package.has_pairs. `sums` is overwritten, its buffers are used again. Errors: as those of the pixels; CANCELLED
// follows `control`.
Status Measure(TileWorkspace& work, TileImages& images, const TileSnapshot& snapshot, const TileStep& at,
               const TileRefineOptions& options, const TaskControl& control, const Clock& clock, StepSums* sums);

// The part of `sums` that other tiles read: those of the core and of the sample.
TileSums CoreSums(const TileWorkspace& work, const StepSums& sums);

}  // namespace tessera
