#include <nlohmann/json.hpp>

#include "common/tile/task_parameters.h"
#include "worker/tasks/methods.h"
#include "worker/tasks/refine_tile.h"
#include "worker/tasks/stages.h"
#include "worker/tasks/tile_blend.h"
#include "worker/tasks/tile_files.h"
#include "worker/tasks/tile_views.h"

namespace tessera {

StatusOr<TaskOutcome> RunRefine(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const RefineParameters parameters, ParseRefineParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(const TilePackage package, ReadTilePackage(InputPath(request, kTileFile)));
  TileState state;
  if (!parameters.results.empty()) {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<TileResult> results,
                             ReadTileResults(request.input_dir, parameters.results));
    TESSERA_ASSIGN_OR_RETURN(state, JoinResults(package, results, parameters.results, parameters.blend_m));
  }
  TESSERA_ASSIGN_OR_RETURN(const std::vector<TileView> views, OpenTileViews(package, InputPath(request, kViewsFile)));
  const double seconds_loading = SecondsSince(clock, start_us);

  TESSERA_ASSIGN_OR_RETURN(TileRefineOptions options, MethodOptions(parameters, package.classes));
  options.geometry.clock = &clock;
  options.geometry.scratch_folder = request.output_dir;
  TESSERA_ASSIGN_OR_RETURN(TileRefinement refinement,
                           RefineTile(package, views, std::move(state), options, PartOf(control, 0, 0.99), clock));
  KeepBlended(package, parameters.tile.core, parameters.blend_m, &refinement.result);
  TESSERA_RETURN_IF_ERROR(WriteTileResult(OutputPath(request, kResultFile), refinement.result));

  TaskOutcome outcome;
  outcome.outputs = {kResultFile};
  nlohmann::json stats = nlohmann::json::parse(refinement.result.report);
  stats["seconds_loading"] = seconds_loading;
  stats["seconds_geometry"] = refinement.seconds_geometry;
  stats["seconds_labels"] = refinement.seconds_labels;
  stats["seconds"] = SecondsSince(clock, start_us);
  outcome.stats = stats.dump();
  return outcome;
}

}  // namespace tessera
