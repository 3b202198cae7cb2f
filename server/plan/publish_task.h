// The task that publishes the states of all tiles.
#pragma once

#include <optional>
#include <vector>

#include "common/job/survey.h"
#include "server/plan/graph_tile.h"
#include "server/plan/planned_task.h"

namespace tessera {

struct PublishWork {
  const Survey& survey;
  const std::vector<GraphTile>& tiles;  // with their last states
  TaskId city_from, survey_from;        // tasks with kCityFile and kPlainSurveyFile
  std::optional<PlannedInput> outdated;  // kOutdatedFile
  bool flip_edges = false;
};

PlannedTask PlanPublish(const PublishWork& work);

}  // namespace tessera
