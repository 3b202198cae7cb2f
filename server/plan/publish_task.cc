#include "server/plan/publish_task.h"

#include <algorithm>

namespace tessera {

PlannedTask PlanPublish(const PublishWork& work) {
  PublishParameters parameters;
  SetReported(work.survey, &parameters);
  PlannedTask task;
  task.kind = task.name = kPublishKind;
  SetCost(PredictPublish(work.survey), &task);
  task.inputs = {{work.city_from, kCityFile}, {work.survey_from, kPlainSurveyFile}};
  for (const GraphTile& tile : work.tiles) {
    parameters.tiles.push_back(tile.parameters);
    if (tile.gone()) continue;
    if (!tile.redone) parameters.kept.push_back(tile.parameters.tile);
    if (tile.quarantined()) parameters.quarantined.push_back(tile.parameters.tile);
    task.inputs.push_back(*tile.state);
  }
  // If no tile is refined, the result, and so the key, is that of the base.
  const auto redone = [](const GraphTile& tile) { return tile.redone; };
  if (std::none_of(work.tiles.begin(), work.tiles.end(), redone)) parameters.kept.clear();
  if (work.outdated) task.inputs.push_back(*work.outdated);
  parameters.outdated = work.outdated.has_value();
  parameters.flip_edges = work.flip_edges;
  task.parameters = ToJson(parameters);
  return task;
}

}  // namespace tessera
