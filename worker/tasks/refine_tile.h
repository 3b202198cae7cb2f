// Refining a tile: geometry and labels in turn.
#ifndef TESSERA_WORKER_TASKS_REFINE_TILE_H_
#define TESSERA_WORKER_TASKS_REFINE_TILE_H_

#include <limits>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "worker/label/belief_propagation.h"
#include "worker/label/label_field.h"
#include "worker/refine/refine.h"
#include "worker/tasks/tile_blend.h"
#include "worker/tasks/tile_files.h"
#include "worker/tasks/tile_views.h"

namespace tessera {

struct TileRefineOptions {
  int begin = 0, end = std::numeric_limits<int>::max();  // of the steps (MakeRefineSteps)
  int rounds = 1;                     // of geometry, then labels; always all of them, so that tiles do alike
  bool labels_first = false;          // before the first geometry too; always, if it knows labels and there are none
  bool geometry_knows_labels = true;  // false: the geometry sees a mesh without labels
  RefineOptions geometry;
  LabelOptions label;
  SolverOptions solver;
};

struct TileRefinement {
  TileResult result;
  double seconds_geometry = 0, seconds_labels = 0;
};

// `views` as OpenTileViews gives them; `state`: what earlier steps made of the tile, TileState() before the first. Some
// of the steps after the others give the bytes of all at once. The result is of the whole package. Without likelihoods
// labels are carried through; with fewer than two views the geometry stays. CANCELLED follows `control`.
StatusOr<TileRefinement> RefineTile(const TilePackage& package, const std::vector<TileView>& views, TileState state,
                                    const TileRefineOptions& options, const TaskControl& control, const Clock& clock);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_REFINE_TILE_H_
