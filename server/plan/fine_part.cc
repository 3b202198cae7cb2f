#include "server/plan/fine_part.h"

#include <algorithm>
#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/plan/stages.h"
#include "server/plan/update_plan.h"
#include "server/tiling/quote.h"

namespace tessera {

StatusOr<PlannedTask> PlanSplit(const JobSettings& settings, const Survey& survey, const std::vector<GraphTile>& tiles,
                                const std::vector<PlannedTask>& planned, TaskId city_from) {
  TESSERA_ASSIGN_OR_RETURN(const Quote quote, MakeQuote(settings, survey));
  PlannedTask task;
  task.kind = task.name = kSplitKind;
  SetCost(quote.split, &task);
  task.parameters = ToJson(SplitParameters{static_cast<int>(tiles.size())});
  task.inputs = {{city_from, kCityFile}, {city_from, kSurveyFile}};
  for (const GraphTile& tile : tiles) task.inputs.push_back(*tile.state);
  double cost = task.cost;
  int64_t bytes = task.stored_bytes;
  for (const PlannedTask& each : planned) {
    cost += each.cost;
    bytes += each.stored_bytes;
  }
  task.later_cost = std::max(0.0, quote.core_seconds - cost);
  task.later_bytes = std::max<int64_t>(0, quote.stored_bytes - bytes);
  return task;
}

void SetFineIterations(const JobSettings& settings, CutParameters* cut) {
  const std::vector<RefineStep> steps = StepsOf(settings);
  std::map<int, int> of_round;
  for (size_t s = static_cast<size_t>(FirstFineStepOf(settings)); s < steps.size(); ++s) {
    if (!steps[s].labels()) ++of_round[steps[s].round];
  }
  cut->fine_iterations.clear();
  for (const auto& [round, iterations] : of_round) cut->fine_iterations.push_back(iterations);
  cut->max_step_px = settings.method_settings.max_step_px;
}

StatusOr<Survey> SurveyOf(const FinePart& fine, const Survey& before) {
  TESSERA_ASSIGN_OR_RETURN(Survey survey, ParseSurvey(fine.survey));
  if (survey.views.size() == before.views.size() && survey.ground.cell_m == before.ground.cell_m) return survey;
  return absl::InvalidArgumentError(absl::StrCat("the survey after the second split: found ", survey.views.size(),
                                                 " views and cells of ", survey.ground.cell_m, " m, expected ",
                                                 before.views.size(), " views and cells of ", before.ground.cell_m,
                                                 " m"));
}

std::vector<GraphTile> TilesOf(const FinePart& fine, const std::vector<GraphTile>& coarse, const Survey& survey) {
  std::vector<TileParameters> cores;
  for (const GraphTile& tile : coarse) cores.push_back(tile.parameters);
  const CellIndex cells(survey);
  std::vector<GraphTile> tiles;
  for (const TileParameters& parameters : GrownTiles(std::move(cores), survey)) {
    GraphTile& tile = tiles.emplace_back();
    tile.parameters = parameters;
    tile.redone = !tile.gone();
    if (tile.redone) tile.work = InFinePart(MeasureTile(cells, parameters.core));
    if (const auto crop = fine.crops.find(parameters.tile); crop != fine.crops.end()) {
      tile.coarse_crop = PlannedInput{crop->second, kViewsFile, parameters.tile};
    }
    if (!std::binary_search(fine.left_out.begin(), fine.left_out.end(), parameters.tile)) continue;
    tile.frozen_from = kNoCut;
    tile.left_out = true;
  }
  return tiles;
}

}  // namespace tessera
