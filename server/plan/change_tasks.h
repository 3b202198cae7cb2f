// Tasks of an update that detect changes of the ground.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "common/job/survey.h"
#include "server/plan/planned_task.h"

namespace tessera {

// Inputs of the change tasks.
struct ChangeWork {
  struct Tile {
    TileParameters parameters;          // of the base for a removed tile
    PlannedInput before;                // kStateFile of the base
    std::optional<PlannedInput> after;  // final kStateFile; none for a removed tile
  };
  const Survey& survey;
  const std::vector<std::vector<PlannedTask::ViewFile>>& files_of_view;
  const std::vector<std::optional<PlannedInput>>& classified;  // per view: likelihoods computed by the job
  size_t views_of_base = 0;                                    // later views are new
  TaskId base_from, city_from, survey_from;                    // tasks with the base's outputs, new city, new survey
  size_t first_task = 0;                                       // index of the first of these tasks in the job's list
  std::vector<Tile> tiles;
  std::optional<PlannedInput> outdated;  // the base's kOutdatedFile
};

// One task for each ground block with a cell that chose a new view; it compares the block with the new views. The last
// task reports the changes of all blocks. Empty if no cell chose a new view.
std::vector<PlannedTask> PlanChanges(const ChangeWork& work);

}  // namespace tessera
