// Stages of a tiled job: a stage is the tasks of one kind and step, of all tiles. A quarantined tile is frozen from some
// stage on. All functions are pure.
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "common/job/refine_steps.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "server/plan/graph_tile.h"
#include "server/settings/job_settings.h"

namespace tessera {

// A tile that is quarantined because one of its tasks failed permanently. Its neighbours freeze the vertices that they
// share with it.
struct FailedTile {
  int tile = -1;
  std::string kind;     // of the failed task: cut, crop, measure, solve or mend
  int step = -1;        // as in StepParameters; -1 for cut and crop
  bool before = false;  // as in StepParameters
  bool fine = false;    // of a task of the fine part (JobPart)
  friend bool operator==(const FailedTile&, const FailedTile&) = default;
};

// Indices of the active steps of a part of a job, ascending. `continues_base`: it starts from the states of an update's
// base.
std::vector<int> StepsTaken(const JobSettings& settings, const Survey& survey, bool continues_base,
                            JobPart part = JobPart::kWhole);

// INVALID_ARGUMENT if no step is active: publish needs a state of each tile.
Status CheckSteps(const JobSettings& settings, const Survey& survey, bool continues_base);
// FAILED_PRECONDITION unless there are `cut` entries; INVALID_ARGUMENT if one names a tile that does not exist.
Status CheckReads(const std::vector<TileReads>& reads, size_t cut, size_t tiles);

// In place of a stage: of a tile that was not cut, and of one that was cut but has no state. Smaller than all stages.
inline constexpr int kNoCut = std::numeric_limits<int>::min(), kNoState = -1;

// Index of a task's stage. Each step has four: mend before it, measure, solve, mend.
int StageOf(const std::string& kind, int step, bool before = false);

// Stages after which a tile may be frozen, ascending: its folds are repaired and only labels have changed since.
// Matches PlanSteps.
std::vector<int> StagesWithGoodStates(const JobSettings& settings, const Survey& survey, bool continues_base);

// Whether `a` failed at an earlier stage than `b`: a tile without tasks from `a` on has none from `b` on either.
bool FailedBefore(const FailedTile& a, const FailedTile& b);

// Freezes the tiles that failed in this part of a job (`fine`: JobPart::kFine). `good`: StagesWithGoodStates;
// `from_revised_base`: it starts from the states of a base with another mesh. FAILED_PRECONDITION if a tile has no state
// to keep.
Status FreezeTiles(const std::vector<FailedTile>& failed, const std::vector<int>& good, bool fine,
                   bool from_revised_base, std::vector<GraphTile>* tiles);

// First stage without tasks of the tile: after the last of `good` (ascending) before the failed one. kNoState if there
// is none, so that the tile keeps its start; kNoCut if it was not cut.
int FrozenFrom(const FailedTile& tile, const std::vector<int>& good);

}  // namespace tessera
