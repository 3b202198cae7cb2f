// How a tile is refined: the options and steps of the methods.
#pragma once

#include <vector>

#include "common/base/status.h"
#include "common/job/refine_steps.h"
#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "worker/label/belief_propagation.h"
#include "worker/label/label_field.h"
#include "worker/photo/data_term.h"
#include "worker/refine/stepper.h"
#include "worker/tile/tile_files.h"

namespace tessera {

struct TileRefineOptions {
  bool geometry_uses_labels = true;  // false: iterations see a mesh without labels
  DataOptions data;
  StepperOptions step;
  LabelOptions label;
  SolverOptions solver;
};

// Whether iterations use labels. With one class alone labels say nothing.
inline bool GeometryUsesLabels(const TilePackage& package, const TileRefineOptions& options) {
  return options.geometry_uses_labels && package.classes.size() > 1;
}

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

// All methods share kernels, density, pairs, pyramid and iterations per round. They differ in:
// - tessera: E_photo, E_contour, smoothness per class that spares creases; labels are also solved before the geometry.
// - baseline: Vu et al. 2012. E_photo and one smoothness for all faces; labels are solved once, at the end.
// - paper: Bláha et al. 2017. All four terms; vertices with faces of several labels have no E_intra, only E_inter; five
// rounds, the paper's label energy.
//   Weights, steps and pairs are those of tessera, because the paper does not give them.
// `classes`: smoothness per class, for methods that use labels. `parameters.settings` override the method's values.
// INVALID_ARGUMENT for an unknown method and for settings out of range.
StatusOr<TileRefineOptions> MethodOptions(const RefineParameters& parameters, const std::vector<SceneClass>& classes);

// The same for a tile's package, including its statistics of class borders.
StatusOr<TileRefineOptions> MethodOptions(const RefineParameters& parameters, const TilePackage& package);

// The active steps of a job for this package (ActiveSteps) that belong to `parameters.part`. Settings must pass
// CheckMethod.
std::vector<TileStep> ActiveTileSteps(const RefineParameters& parameters, const TilePackage& package);

// Whether `step` (index in RefineStepsOf) is the last active step of a job that moves vertices.
bool IsLastOfMoves(const RefineParameters& parameters, const TilePackage& package, int step);

}  // namespace tessera
