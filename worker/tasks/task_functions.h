// The tasks, one a file, in the order of the line. Each reads its inputs from request.input_dir and writes its
// outputs to request.output_dir; errors and promises as RunTask's.
#ifndef TESSERA_WORKER_TASKS_TASK_FUNCTIONS_H_
#define TESSERA_WORKER_TASKS_TASK_FUNCTIONS_H_

#include <string>

#include "common/base/elapsed.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "worker/tasks/task.h"

namespace tessera {

// Scene → the repaired and split mesh of the city, and the survey: GSD, cells and their views, pairs.
StatusOr<TaskOutcome> RunIngest(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// An earlier job's survey and city, and a scene → the survey with the scene's views taken in.
StatusOr<TaskOutcome> RunUpdate(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City, classifier and a photograph → its likelihoods, and what they and its edges say of each other's borders.
StatusOr<TaskOutcome> RunClassify(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// What these say of all photographs → how far borders of likelihoods can be trusted.
StatusOr<TaskOutcome> RunBorders(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City and survey → a tile's package, and which tiles it reads.
StatusOr<TaskOutcome> RunCut(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package and photographs → the pixels that see the tile, which its steps read.
StatusOr<TaskOutcome> RunCrop(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package and pixels of a job's only tile → its state after all steps.
StatusOr<TaskOutcome> RunRefine(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package, pixels and the states of the tiles in sight → what the pixels say of each face of the core in one step.
StatusOr<TaskOutcome> RunMeasure(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package, sums and states of the tiles in reach → the core's state after the step.
StatusOr<TaskOutcome> RunSolve(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package and states of the tiles in reach → the core's state with folds repaired.
StatusOr<TaskOutcome> RunRepair(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City and survey → a tile's core as it is at the start, where its refinement failed.
StatusOr<TaskOutcome> RunStart(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City, survey, states of an update's base and new photographs → what they show of a block of ground.
StatusOr<TaskOutcome> RunCompare(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// All of that, and the last states → changes.json, changes.geojson, changes.png.
StatusOr<TaskOutcome> RunChanges(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City, survey and the last states → mesh.ply in the scene's own frame, and report.json.
StatusOr<TaskOutcome> RunPublish(const TaskRequest& request, const TaskControl& control, const Clock& clock);

inline std::string InputPath(const TaskRequest& request, const std::string& name) {
  return request.input_dir + "/" + name;
}
inline std::string OutputPath(const TaskRequest& request, const std::string& name) {
  return request.output_dir + "/" + name;
}

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_TASK_FUNCTIONS_H_
