#include <nlohmann/json.hpp>

#include "common/job/task_parameters.h"
#include "worker/tasks/step_task.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/solve_tile.h"

namespace tessera {

StatusOr<TaskOutcome> RunSolve(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(StepTask task, OpenStepTask(request, kLabelRegion, kSolveRegion));
  TESSERA_ASSIGN_OR_RETURN(const SumsOfTiles tiles, OpenSumsOf(request, task.parameters));
  const bool labels = task.at.labels();
  const double seconds_loading = SecondsSince(clock, start_us);
  control.Report(0.3, labels ? "labelling" : "moving");
  CompareSample(task.work->package(), tiles, &task.snapshot);
  CountSeams(&task.snapshot);
  TESSERA_ASSIGN_OR_RETURN(const StepSums sums, AssembleSums(*task.work, tiles, task.at, task.snapshot));
  Solve(*task.work, task.at, sums, task.options, &task.snapshot);
  control.Report(0.95, "writing the state");
  const TileState state = task.work->StateOf(task.snapshot);
  TESSERA_RETURN_IF_ERROR(WriteTileState(OutputPath(request, kStateFile), state));
  TaskOutcome outcome;
  outcome.outputs = {kStateFile};
  outcome.warnings = SeamWarnings(task.work->package().tile, task.snapshot);
  outcome.stats =
      nlohmann::json{{"seconds_loading", seconds_loading},
                     {labels ? "seconds_labels" : "seconds_step", SecondsSince(clock, start_us) - seconds_loading},
                     {"compared_vertices", task.snapshot.compared},
                     {"different_vertices", task.snapshot.different},
                     {"farthest_m", task.snapshot.farthest_m},
                     {"mean_confidence", MeanConfidence(state)},
                     {"seconds", SecondsSince(clock, start_us)}}
          .dump();
  return outcome;
}

}  // namespace tessera
