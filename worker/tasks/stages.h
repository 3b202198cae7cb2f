// The six tasks, one a file, in the order of the line. Each reads its inputs from request.input_dir and writes its
// outputs to request.output_dir; errors and promises as RunTask's.
#ifndef TESSERA_WORKER_TASKS_STAGES_H_
#define TESSERA_WORKER_TASKS_STAGES_H_

#include <string>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "worker/tasks/task.h"

namespace tessera {

// Scene → the repaired and split mesh of the city, and the survey: GSD, cells and their views, pairs.
StatusOr<TaskOutcome> RunIngest(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City and survey → a tile's package: core, halo, occluders, views.
StatusOr<TaskOutcome> RunCut(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package and photographs → the pixels that see the tile, which all parts of its refinement read.
StatusOr<TaskOutcome> RunCrop(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package and pixels → the tile's refined positions, labels and beliefs; or those after some of the steps.
StatusOr<TaskOutcome> RunRefine(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package and the results that reach into its core → the core, blended.
StatusOr<TaskOutcome> RunStitch(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City, survey and all cores → mesh.ply in the scene's own frame, and report.json.
StatusOr<TaskOutcome> RunPublish(const TaskRequest& request, const TaskControl& control, const Clock& clock);

inline std::string InputPath(const TaskRequest& request, const std::string& name) {
  return request.input_dir + "/" + name;
}
inline std::string OutputPath(const TaskRequest& request, const std::string& name) {
  return request.output_dir + "/" + name;
}

// The part [low, high] of `control`'s progress as a whole of its own. `control` must outlive it.
inline TaskControl PartOf(const TaskControl& control, double low, double high) {
  TaskControl part;
  part.cancelled = control.cancelled;
  part.report = [&control, low, high](double fraction, const std::string& stage) {
    control.Report(low + (high - low) * fraction, stage);
  };
  return part;
}

inline double SecondsSince(const Clock& clock, int64_t start_us) { return 1e-6 * (clock.MonotonicUs() - start_us); }

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_STAGES_H_
