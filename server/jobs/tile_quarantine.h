// Jobs that continue without a tile whose refinement fails: the tile is quarantined.
#pragma once

#include <string>
#include <vector>

#include "server/ledger/job.h"
#include "server/plan/planned_task.h"
#include "server/plan/stages.h"

namespace tessera {

// Whether the job can continue without the tile of its task that has failed for good (Job::failed): a step of one of
// several tiles, for another reason than wrong input, which the user has to correct. A job whose tiles all fail fails.
bool CanContinueWithout(const Job& job);

// The quarantined tiles of the job, in the form that the planner takes.
std::vector<FailedTile> QuarantinedTiles(const Job& job);

// "tile 3 was quarantined: 'solve tile 3 step 4' failed (poison): ...".
std::string QuarantineText(const Job& job, const QuarantinedTile& tile);

// What a plan made anew changes: what is in both stays, with all that was done for it.
struct PlanChange {
  std::vector<PlannedTask> added;  // to the end of the job's list
  std::vector<int> superseded;     // of the job's list, ascending
};
struct KnownTask {
  PlannedTask plan;
  bool superseded = false;
};
// `known`: the job's tasks from `first` on; `tasks`: what is to be in place of them, with inputs as if it stood there.
PlanChange ChangePlan(int first, const std::vector<KnownTask>& known, std::vector<PlannedTask> tasks);

// The first task behind the job's cuts.
int FirstBehindCuts(const Job& job);

}  // namespace tessera
