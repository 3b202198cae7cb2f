// The tasks that jobs with a base have beside those of the line.
#ifndef TESSERA_SERVER_PLAN_UPDATE_TASKS_H_
#define TESSERA_SERVER_PLAN_UPDATE_TASKS_H_

#include <cstddef>
#include <optional>
#include <vector>

#include "common/job/survey.h"
#include "server/plan/cost_model.h"
#include "server/plan/graph.h"

namespace tessera {

// Before the survey tells more: what a file of the scene takes ingest.
inline constexpr double kIngestSecondsPerFile = 0.1;

inline void SetCost(const Prediction& cost, PlannedTask* task) {
  task->cost = cost.core_seconds;
  task->peak_bytes = cost.peak_bytes;
  task->stored_bytes = cost.stored_bytes;
}

// What ingest, or an update in its place, needs to know of the settings.
IngestParameters IngestParametersOf(const JobSettings& settings);

// What the model's seconds are corrected by. `survey`: the base's.
CostScale CostsOf(const UpdateBase& base, const Survey& survey);

// What the report of changes is made from.
struct ChangeWork {
  struct Tile {
    TileParameters parameters;          // of one that is gone: the base's
    PlannedInput before;                // its kStateFile of the base
    std::optional<PlannedInput> after;  // the last; none of a tile that is gone
  };
  const Survey& survey;
  const std::vector<std::vector<PlannedTask::ViewFile>>& files_of_view;
  const std::vector<std::optional<PlannedInput>>& classified;  // likelihoods of views that the job makes itself
  size_t views_of_base = 0;                                    // those behind are new
  TaskId base_from, city_from, survey_from;                    // whose kCityFile was before, and is now
  size_t first_task = 0;                                       // place of the first of these tasks in the job's list
  std::vector<Tile> tiles;
  std::optional<PlannedInput> outdated;  // the base's kOutdatedFile
};

// A task for each block of ground of which a cell chose a new view, which looks at it in these, and last one that
// reports what all of them found; none, if no cell did.
std::vector<PlannedTask> PlanChanges(const ChangeWork& work);

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_UPDATE_TASKS_H_
