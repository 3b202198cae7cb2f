// The order of what the tiles of a job do together, and from where on one that is quarantined stays as it is.
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "common/job/refine_steps.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "server/settings/job_settings.h"

namespace tessera {

// A tile that is left as it was because a task of it failed for good. Its neighbours hold what they share with it.
struct FailedTile {
  int tile = -1;
  std::string kind;     // of the task: cut, crop, measure, solve or mend
  int step = -1;        // of the last three, as in StepParameters
  bool before = false;  // likewise
  friend bool operator==(const FailedTile&, const FailedTile&) = default;
};

std::vector<RefineStep> StepsOf(const JobSettings& settings);
// Indices of those that a job of several tiles takes, ascending. `goes_on`: from the states of an update's base.
std::vector<int> StepsTaken(const JobSettings& settings, const Survey& survey, bool goes_on);

// Publish needs a state of each tile: some step has to be taken.
Status CheckSteps(const JobSettings& settings, const Survey& survey, bool goes_on);
// One for each tile that was cut, and of tiles that there are.
Status CheckReads(const std::vector<TileReads>& reads, size_t cut, size_t tiles);

// Of a tile that was not even cut, and of one that was but took part in no stage. Every stage is later.
inline constexpr int kNoCut = std::numeric_limits<int>::min(), kNoState = -1;

// Place of a task among the stages of a job, from 0: for each step mend (before it), measure, solve, mend.
int StageOf(const std::string& kind, int step, bool before = false);

// Those that leave a tile as it may stay, ascending: its folds are mended, and nothing but labels changed since. As
// PlanSteps plans them.
std::vector<int> StagesWithGoodStates(const JobSettings& settings, const Survey& survey, bool goes_on);

// The stage from which on the tile has no tasks: after the last of `good` (ascending) before the one that failed.
// kNoState if there is none: it stays as it is at the job's start; kNoCut if it was not cut.
int FrozenFrom(const FailedTile& tile, const std::vector<int>& good);

}  // namespace tessera
