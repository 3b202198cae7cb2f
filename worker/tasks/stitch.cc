#include <nlohmann/json.hpp>

#include "worker/tasks/stages.h"
#include "worker/tasks/stitch_tile.h"
#include "worker/tasks/tile_blend.h"

namespace tessera {

StatusOr<TaskOutcome> RunStitch(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const StitchParameters parameters, ParseStitchParameters(request.parameters));
  control.Report(0, "reading results");
  TESSERA_ASSIGN_OR_RETURN(const TilePackage package, ReadTilePackage(InputPath(request, kTileFile)));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<TileResult> results,
                           ReadTileResults(request.input_dir, parameters.results));
  TESSERA_RETURN_IF_ERROR(control.Check());
  control.Report(0.5, "blending");
  TESSERA_ASSIGN_OR_RETURN(const TileCore core, StitchTile(package, results, parameters));
  TESSERA_RETURN_IF_ERROR(WriteTileCore(OutputPath(request, kCoreFile), core));
  TaskOutcome outcome;
  outcome.outputs = {kCoreFile};
  nlohmann::json stats = nlohmann::json::parse(core.report)["seam"];
  stats["seconds"] = SecondsSince(clock, start_us);
  outcome.stats = stats.dump();
  return outcome;
}

}  // namespace tessera
