// Tasks that crop the images for the tiles.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "common/job/survey.h"
#include "server/plan/graph_tile.h"
#include "server/plan/planned_task.h"

namespace tessera {

struct CropWork {
  const Survey& survey;
  const std::vector<std::vector<PlannedTask::ViewFile>>& files_of_view;
  const std::vector<std::optional<PlannedInput>>& classified;  // per view: likelihoods computed by the job
  size_t first_task = 0;                                       // index of the first of these tasks in the job's list
  int64_t max_peak_bytes = 0;                                  // MaxCropGroupPeak_bytes
};

// A task for each group of tiles (CropGroupsOf). Its tile is the first one: if the task fails for good, this tile is
// quarantined, and the others get a task each. Sets GraphTile::crop.
std::vector<PlannedTask> PlanCrops(const CropWork& work, std::vector<GraphTile>* tiles);

// The tiles that the task crops, each with `id`, the index of the task; none if it is of another kind.
std::map<int, TaskId> CropsByTile(const PlannedTask& task, TaskId id);

}  // namespace tessera
