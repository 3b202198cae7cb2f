#include <nlohmann/json.hpp>

#include "common/base/pick.h"
#include "common/job/task_parameters.h"
#include "worker/tasks/step_task.h"
#include "worker/tasks/task_functions.h"
#include "worker/tile/repair_core.h"

namespace tessera {
StatusOr<TaskOutcome> RunRepair(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(StepTask task, OpenStepTask(request, kRepairRegion, kRepairRegion));
  TileWorkspace& work = *task.work;
  TileSnapshot& snapshot = task.snapshot;
  const double seconds_loading = SecondsSince(clock, start_us);
  CoreRepair repaired;
  if (work.package().compares) {
    control.Report(0.2, "repairing folds");
    const RegionMesh& region = work.region(kRepairRegion);
    std::vector<uint8_t> core;
    for (const uint32_t f : region.faces) core.push_back(work.package().regions[f] & kCoreRegion);
    const StepperOptions& options = task.options.geometry;
    std::vector<Eigen::Vector3d> good, positions = Pick(snapshot.positions, region.vertices);
    if (task.parameters.before) {
      good = MotionGuard(region.mesh, region.boundary, MakeMotionLimits(options, work.package().gsd_m)).UnfoldedStart();
      // Frozen vertices stay where they are. The base's result counts as motion from the start.
      const std::vector<uint8_t> frozen = Pick(snapshot.frozen_vertices, region.vertices);
      for (size_t v = 0; v < frozen.size(); ++v) {
        if (frozen[v]) good[v] = positions[v];
      }
      if (task.parameters.first_new_face < 0) positions.swap(good);
    } else {
      if (snapshot.level_start.empty()) return absl::DataLossError("repair: the states have no level start");
      good = Pick(snapshot.level_start, region.vertices);
    }
    repaired = RepairCore(region, core, work.package().gsd_m, options, good, &positions);
    for (size_t v = 0; v < positions.size(); ++v) snapshot.positions[region.vertices[v]] = positions[v];
    work.Forget(kRepairRegion);
  }
  snapshot.level_start.clear();
  snapshot.last_step.clear();
  CountSeams(&snapshot);
  if (snapshot.confidence.empty()) {
    const int classes = static_cast<int>(work.package().classes.size());
    for (const int32_t label : snapshot.labels) snapshot.confidence.push_back(CarriedConfidence(classes, label));
  }
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
