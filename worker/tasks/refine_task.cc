#include <nlohmann/json.hpp>

#include "common/job/task_parameters.h"
#include "worker/tasks/step_task.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/kept/kept_files.h"
#include "worker/tile/methods.h"
#include "worker/tile/refine_tile.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_workspace.h"

namespace tessera {

StatusOr<TaskOutcome> RunRefine(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const RefineParameters parameters, ParseRefineParameters(request.parameters));
  TESSERA_ASSIGN_OR_RETURN(TilePackage package, ReadTilePackage(InputPath(request, kTileFile)));
  TileWorkspace work(std::move(package));
  TESSERA_ASSIGN_OR_RETURN(const TileRefineOptions options, MethodOptions(parameters, work.package()));
  const std::vector<std::string> crops = CropsOf(request, work.package().tile);
  TESSERA_ASSIGN_OR_RETURN(TileImages* const images, work.Images(crops, options));
  std::shared_ptr<const MappedState> start;
  if (parameters.part == JobPart::kFine) {
    TESSERA_ASSIGN_OR_RETURN(start,
                             OpenState(InputPath(request, TileInputName(work.package().tile, kStateFile))));
  }
  const double seconds_loading = SecondsSince(clock, start_us);
  TESSERA_ASSIGN_OR_RETURN(const TileRefinement refinement,
                           RefineTile(work, *images, ActiveTileSteps(parameters, work.package()), options,
                                      start.get(), parameters.part != JobPart::kCoarse, PartOf(control, 0, 0.99),
                                      clock));
  TESSERA_RETURN_IF_ERROR(WriteTileState(OutputPath(request, kStateFile), refinement.state));

  TaskOutcome outcome;
  outcome.outputs = {kStateFile};
  if (refinement.left_faces > 0) outcome.warnings.push_back(FoldWarning(work.package().tile, refinement.left_faces));
  nlohmann::json stats = nlohmann::json::parse(refinement.state.report);
  stats["mean_confidence"] = MeanConfidence(refinement.state);
  stats["seconds_loading"] = seconds_loading + refinement.seconds_loading;
  stats["seconds_visibility"] = refinement.seconds_visibility;
  stats["seconds_data"] = refinement.seconds_data;
  stats["seconds_step"] = refinement.seconds_step;
  stats["seconds_repair"] = refinement.seconds_repair;
  stats["seconds_labels"] = refinement.seconds_labels;
  stats["seconds"] = SecondsSince(clock, start_us);
  outcome.stats = stats.dump();
  return outcome;
}

}  // namespace tessera
