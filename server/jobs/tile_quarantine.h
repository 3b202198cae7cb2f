// Quarantine of tiles: a job continues without a tile whose refinement fails.
#pragma once

#include <string>
#include <vector>

#include "server/ledger/job.h"
#include "server/plan/planned_task.h"
#include "server/plan/stages.h"

namespace tessera {

// Whether the job can continue without the tile of its failed task (Job::failed). Not if the task is no step of a tile,
// if the input is wrong (the user must correct it), if storage failed, or if no tile would be left.
bool CanContinueWithout(const Job& job);

// The quarantined tiles of the job, for the planner.
std::vector<FailedTile> QuarantinedTiles(const Job& job);

// "tile 3 was quarantined: 'solve tile 3 step 4' failed (poison): ...".
std::string QuarantineText(const Job& job, const QuarantinedTile& tile);

// Changes from the old plan to the new one. Tasks in both stay with their state.
struct PlanChange {
  std::vector<PlannedTask> added;  // appended to the job's tasks
  std::vector<int> superseded;     // indices in the job's tasks, ascending
};
struct KnownTask {
  PlannedTask plan;
  bool superseded = false;
};
// `known`: the job's tasks from index `first`; `tasks`: their replacement, with inputs numbered from `first`.
PlanChange ChangePlan(int first, const std::vector<KnownTask>& known, std::vector<PlannedTask> tasks);

}  // namespace tessera
