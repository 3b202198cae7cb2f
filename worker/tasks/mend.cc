#include <nlohmann/json.hpp>

#include "common/base/pick.h"
#include "common/job/task_parameters.h"
#include "worker/tasks/stages.h"
#include "worker/tasks/step_task.h"
#include "worker/tile/repair_core.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

}  // namespace

StatusOr<TaskOutcome> RunMend(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(StepTask task, OpenStepTask(request, kMendRegion, kMendRegion));
  OpenTile& work = *task.work;
  KnownState& known = task.known;
  const double seconds_loading = SecondsSince(clock, start_us);
  CoreRepair repaired;
  if (work.package().compares) {
    control.Report(0.2, "mending");
    const RegionMesh& region = work.region(kMendRegion);
    std::vector<uint8_t> core;
    for (const uint32_t f : region.faces) core.push_back(work.package().regions[f] & kCoreRegion);
    const StepperOptions& options = task.options.geometry;
    std::vector<Vector3d> good, positions = Pick(known.positions, region.vertices);
    if (task.parameters.before) {
      good = MotionGuard(region.mesh, region.fixed, MakeMotionLimits(options, work.package().gsd_m)).UnfoldedStart();
      // What is held stays; the base's result among faces that are new: as if it had all moved there from the start.
      const std::vector<uint8_t> held = Pick(known.held_vertices, region.vertices);
      for (size_t v = 0; v < held.size(); ++v) {
        if (held[v]) good[v] = positions[v];
      }
      if (task.parameters.first_new_face < 0) positions.swap(good);
    } else {
      if (known.level_start.empty()) return absl::DataLossError("mend: the states have no beginning of the level");
      good = Pick(known.level_start, region.vertices);
    }
    repaired = RepairCore(region, core, work.package().gsd_m, options, good, &positions);
    for (size_t v = 0; v < positions.size(); ++v) known.positions[region.vertices[v]] = positions[v];
    work.Forget(kMendRegion);
  }
  known.level_start.clear();
  known.last_step.clear();
  CountSeams(&known);
  if (known.confidence.empty()) {
    const int classes = static_cast<int>(work.package().classes.size());
    for (const int32_t label : known.labels) known.confidence.push_back(CarriedConfidence(classes, label));
  }
  TESSERA_RETURN_IF_ERROR(WriteTileState(OutputPath(request, kStateFile), work.StateOf(known)));
  TaskOutcome outcome;
  outcome.outputs = {kStateFile};
  outcome.warnings = SeamWarnings(work.package().tile, known);
  if (repaired.left_faces > 0) outcome.warnings.push_back(FoldWarning(work.package().tile, repaired.left_faces));
  outcome.stats = nlohmann::json{{"seconds_loading", seconds_loading},
                                 {"seconds_repair", SecondsSince(clock, start_us) - seconds_loading},
                                 {"repaired_vertices", repaired.changed_vertices},
                                 {"seconds", SecondsSince(clock, start_us)}}
                      .dump();
  return outcome;
}

}  // namespace tessera
