// Refinement options of the methods.
#pragma once

#include <vector>

#include "common/base/status.h"
#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "worker/tile/tile_options.h"
#include "worker/tile/tile_step.h"

namespace tessera {

// All methods share kernels, density, pairs, pyramid and iterations per round. They differ in:
// - tessera: E_photo, E_contour, smoothness per class that spares creases; labels are also solved before the geometry.
// - baseline: Vu et al. 2012. E_photo and one smoothness for all faces; labels are solved once, at the end.
// - paper: Bláha et al. 2017. All four terms, no smoothness except E_inter, five rounds, the paper's label energy.
//   Weights, steps and pairs are those of tessera, because the paper does not give them.
// `classes`: smoothness per class, for methods that use labels. `parameters.settings` override the method's values.
// INVALID_ARGUMENT for an unknown method and for settings out of range.
StatusOr<TileRefineOptions> MethodOptions(const RefineParameters& parameters, const std::vector<SceneClass>& classes);

// The same for a tile's package, including its statistics of class borders.
StatusOr<TileRefineOptions> MethodOptions(const RefineParameters& parameters, const TilePackage& package);

// The active steps of a job for this package (ActiveSteps). Settings must pass CheckMethod.
std::vector<TileStep> ActiveTileSteps(const RefineParameters& parameters, const TilePackage& package);

}  // namespace tessera
