#include <nlohmann/json.hpp>

#include "common/job/task_parameters.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/tile_files.h"
#include "worker/tile/tile_views.h"

namespace tessera {

StatusOr<TaskOutcome> RunCrop(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(const TilePackage package, ReadTilePackage(InputPath(request, kTileFile)));
  TESSERA_RETURN_IF_ERROR(CropTileViews(package, request.input_dir, OutputPath(request, kViewsFile), control));
  TaskOutcome outcome;
  outcome.outputs = {kViewsFile};
  outcome.stats = nlohmann::json{{"seconds", SecondsSince(clock, start_us)}}.dump();
  return outcome;
}

}  // namespace tessera
