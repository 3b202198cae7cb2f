// The methods of a job as options of the refinement.
#pragma once

#include <vector>

#include "common/base/status.h"
#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "worker/tile/tile_options.h"
#include "worker/tile/tile_step.h"

namespace tessera {

// All methods share kernels, density, pairs, pyramid and iterations per round. They differ in:
//   tessera   the whole energy, labels in units of the GSD, solved before the geometry too
//   baseline  Vu et al. 2012: E_photo and one smoothness for all; the labels are solved once, at the end, as ours are
//   paper     Bláha et al. 2017: all four terms, no smoothness but E_inter where labels mix, five rounds, the paper's
//   label
//             energy. What the paper leaves open (weights, steps, pairs) is as ours.
// `classes` gives the smoothness a class where the method knows classes; `parameters.settings` goes over the method's
// own values. INVALID_ARGUMENT for an unknown method and for settings out of range.
StatusOr<TileRefineOptions> MethodOptions(const RefineParameters& parameters, const std::vector<SceneClass>& classes);

// The same for a tile's package, with the borders of its likelihoods.
StatusOr<TileRefineOptions> MethodOptions(const RefineParameters& parameters, const TilePackage& package);

// The steps of a job that act on this package (ActiveSteps). Settings as CheckMethod accepts them.
std::vector<TileStep> ActiveTileSteps(const RefineParameters& parameters, const TilePackage& package);

}  // namespace tessera
