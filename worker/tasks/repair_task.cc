#include <nlohmann/json.hpp>

#include "common/job/task_parameters.h"
#include "worker/tasks/step_task.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/repair_tile.h"

namespace tessera {
StatusOr<TaskOutcome> RunRepair(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(StepTask task, OpenStepTask(request, kRepairRegion, kRepairRegion));
  const TileWorkspace& work = *task.work;
  TileSnapshot& snapshot = task.snapshot;
  const double seconds_loading = SecondsSince(clock, start_us);
  control.Report(0.2, "repairing folds");
  RepairStage stage = RepairStage::kLevel;
  if (task.parameters.before) {
    stage = task.parameters.first_new_face < 0 ? RepairStage::kStart : RepairStage::kRevisedStart;
  }
  TESSERA_ASSIGN_OR_RETURN(const CoreRepair repaired, Repair(*task.work, stage, task.options, &snapshot));
  CountSeams(&snapshot);
  TESSERA_RETURN_IF_ERROR(WriteTileState(OutputPath(request, kStateFile), work.StateOf(snapshot)));
  TaskOutcome outcome;
  outcome.outputs = {kStateFile};
  outcome.warnings = SeamWarnings(work.package().tile, snapshot);
  if (repaired.left_faces > 0) outcome.warnings.push_back(FoldWarning(work.package().tile, repaired.left_faces));
  outcome.stats = nlohmann::json{{"seconds_loading", seconds_loading},
                                 {"seconds_repair", SecondsSince(clock, start_us) - seconds_loading},
                                 {"repaired_vertices", repaired.changed_vertices},
                                 {"seconds", SecondsSince(clock, start_us)}}
                      .dump();
  return outcome;
}

}  // namespace tessera
