#include <nlohmann/json.hpp>

#include "common/base/pick.h"
#include "common/job/task_parameters.h"
#include "worker/refine/vertex_sums.h"
#include "worker/tasks/step_task.h"
#include "worker/tasks/task_functions.h"

namespace tessera {
namespace {

using Eigen::Vector3d;
using nlohmann::json;

json* RoundReport(const RefineStep& step, json* report) {
  if (step.round < 0) return &(*report)["labels_first"];
  json& rounds = (*report)["rounds"];
  while (static_cast<int>(rounds.size()) <= step.round) rounds.push_back(json::object());
  return &rounds[step.round];
}

Status SolveLabelStep(const std::vector<TileSums>& sums, StepTask* task, json* report) {
  TileWorkspace& work = *task->work;
  TileSnapshot& snapshot = task->snapshot;
  const RegionMesh& region = work.region(kLabelRegion);
  TESSERA_ASSIGN_OR_RETURN(const FaceLikelihoods likelihoods,
                           work.AssembleLikelihoods(sums, kLabelRegion, snapshot.frozen_faces));
  const std::vector<int32_t> start = Pick(snapshot.labels, region.faces);
  const RegionLabels labelled = LabelRegion(work.package(), region, Pick(snapshot.positions, region.vertices), start,
                                            likelihoods, task->options, Pick(snapshot.frozen_faces, region.faces));
  snapshot.confidence.resize(snapshot.labels.size(), 0.0f);
  int64_t changes = 0;
  for (size_t i = 0; i < region.faces.size(); ++i) {
    const uint32_t f = region.faces[i];
    if (work.package().regions[f] & kCoreRegion) changes += snapshot.labels[f] != labelled.labels[i];
    snapshot.labels[f] = labelled.labels[i];
    snapshot.confidence[f] = labelled.confidence[i];
  }
  (*report)["label_changes"] = changes;
  work.Forget(kLabelRegion);
  return absl::OkStatus();
}

Status SolveIteration(const std::vector<TileSums>& sums, StepTask* task, json* report) {
  TileWorkspace& work = *task->work;
  TileSnapshot& snapshot = task->snapshot;
  if (task->level_iteration == 0) {
    snapshot.level_start = snapshot.positions;
    snapshot.last_step.assign(snapshot.positions.size(), Eigen::Vector3f::Zero());
  }
  const RegionMesh& region = work.region(kSolveRegion);
  TESSERA_ASSIGN_OR_RETURN(const std::vector<FaceSums> photo,
                           work.AssemblePhoto(sums, kSolveRegion, snapshot.frozen_faces));
  TESSERA_ASSIGN_OR_RETURN(const ContourSums contours, work.AssembleContours(sums, kSolveRegion));
  Stepper& stepper = work.SolveStepper(Pick(snapshot.labels, region.faces),
                                       Pick(snapshot.frozen_vertices, region.vertices), task->options);
  TriangleMesh mesh = {Pick(snapshot.positions, region.vertices), region.mesh.faces, {}};
  const std::vector<Vector3d> step =
      stepper.Step(mesh, GatherVertices(mesh, stepper.guard().faces_of_vertex(), photo, contours), task->step.level,
                   task->level_iteration, Pick(snapshot.last_step, region.vertices));
  for (size_t v = 0; v < step.size(); ++v) {
    snapshot.positions[region.vertices[v]] = mesh.vertices[v] + step[v];
    snapshot.last_step[region.vertices[v]] = step[v].cast<float>();
  }
  for (const TileSums& of_tile : sums) {
    if (of_tile.tile != work.package().tile) continue;
    (*report)["warped_pixels"] = report->value("warped_pixels", int64_t{0}) + of_tile.warped_pixels;
    // Only energies of one level compare.
    if (task->step.level != task->options.geometry.levels.back() || of_tile.energy < 0) continue;
    if (!report->contains("photo_energy_start")) (*report)["photo_energy_start"] = of_tile.energy;
    (*report)["photo_energy_end"] = of_tile.energy;
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<TaskOutcome> RunSolve(const TaskRequest& request, const TaskControl& control, const Clock& clock) {
  const int64_t start_us = clock.MonotonicUs();
  TESSERA_ASSIGN_OR_RETURN(StepTask task, OpenStepTask(request, kLabelRegion, kSolveRegion));
  TESSERA_ASSIGN_OR_RETURN(const std::vector<TileSums> sums, ReadSums(request, task.parameters));
  const bool labels = task.step.labels();
  const double seconds_loading = SecondsSince(clock, start_us);
  control.Report(0.3, labels ? "labelling" : "moving");
  CompareSample(task.work->package(), sums, &task.snapshot);
  CountSeams(&task.snapshot);
  json report = json::parse(task.snapshot.report);
  report["faces"] = task.work->core_faces().size();
  json* of_round = RoundReport(task.step, &report);
  if (labels) {
    TESSERA_RETURN_IF_ERROR(SolveLabelStep(sums, &task, of_round));
  } else if (task.work->package().compares) {
    TESSERA_RETURN_IF_ERROR(SolveIteration(sums, &task, of_round));
  }
  task.snapshot.report = report.dump();
  control.Report(0.95, "writing the state");
  TESSERA_RETURN_IF_ERROR(WriteTileState(OutputPath(request, kStateFile), task.work->StateOf(task.snapshot)));
  TaskOutcome outcome;
  outcome.outputs = {kStateFile};
  outcome.warnings = SeamWarnings(task.work->package().tile, task.snapshot);
  outcome.stats = json{{"seconds_loading", seconds_loading},
                       {labels ? "seconds_labels" : "seconds_step", SecondsSince(clock, start_us) - seconds_loading},
                       {"compared_vertices", task.snapshot.compared},
                       {"different_vertices", task.snapshot.different},
                       {"farthest_m", task.snapshot.farthest_m},
                       {"seconds", SecondsSince(clock, start_us)}}
                      .dump();
  return outcome;
}

}  // namespace tessera
