// Runs a whole job in one process, task after task, without coordinator and workers: for tests and benchmarks.
#pragma once

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/task_kinds.h"
#include "server/plan/graph.h"
#include "worker/tasks/task.h"

namespace tessera {

struct LineTask {
  PlannedTask planned;
  std::string output_dir;
  TaskOutcome outcome;
};

// The task that made the first survey and city.
inline const LineTask& IngestOf(const std::vector<LineTask>& tasks) {
  return *std::find_if(tasks.begin(), tasks.end(),
                       [](const LineTask& task) { return task.planned.kind == kIngestKind; });
}

// The task that made the city which publish read: it splits faces again, or is the first.
inline const LineTask& CityTaskOf(const std::vector<LineTask>& tasks) {
  const auto split = std::find_if(tasks.begin(), tasks.end(),
                                  [](const LineTask& task) { return task.planned.kind == kSplitKind; });
  return split == tasks.end() ? IngestOf(tasks) : *split;
}

// Runs `request` instead of RunTask; empty: RunTask.
using TaskRunner = std::function<StatusOr<TaskOutcome>(const TaskRequest&)>;

// Plans and runs the job on `scene_dir` in the plan's order, each task in a folder of its own under `work_dir` (made)
// with nothing but links to its inputs; those that are fetched on demand are linked then. `quarantined`: as if these
// tasks had failed. The last task is publish, if the settings have no exports: its output_dir has mesh.ply.
StatusOr<std::vector<LineTask>> RunLine(const std::string& scene_dir, const std::string& work_dir,
                                        const JobSettings& settings, const TaskRunner& runner = {},
                                        const std::vector<FailedTile>& quarantined = {});

}  // namespace tessera
