// The tasks of an update that find what changed on the ground.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "common/job/survey.h"
#include "server/plan/planned_task.h"

namespace tessera {

// What the report of changes is made from.
struct ChangeWork {
  struct Tile {
    TileParameters parameters;          // of a removed tile: the base's
    PlannedInput before;                // its kStateFile of the base
    std::optional<PlannedInput> after;  // the last; none of a removed tile
  };
  const Survey& survey;
  const std::vector<std::vector<PlannedTask::ViewFile>>& files_of_view;
  const std::vector<std::optional<PlannedInput>>& classified;  // likelihoods of views that the job makes itself
  size_t views_of_base = 0;                                    // those behind are new
  TaskId base_from, city_from, survey_from;                    // whose kCityFile was before, and is now
  size_t first_task = 0;                                       // index of the first of these tasks in the job's list
  std::vector<Tile> tiles;
  std::optional<PlannedInput> outdated;  // the base's kOutdatedFile
};

// One task for each block of ground of which a cell chose a new view: it compares the block in the new views. The last
// task reports the changes of all blocks. Empty if no cell chose a new view.
std::vector<PlannedTask> PlanChanges(const ChangeWork& work);

}  // namespace tessera
