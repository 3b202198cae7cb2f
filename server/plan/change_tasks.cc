#include "server/plan/change_tasks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/job/change_cells.h"

namespace tessera {
namespace {

struct SeenBlock {
  std::set<int32_t> views;  // new views
  double seen_m2 = 0;       // upper bound of the ground area that they show
};

// By y, x of the block.
using SeenBlocks = std::map<std::array<int, 2>, SeenBlock>;

SeenBlocks BlocksThatNewViewsSee(const ChangeWork& work, double side_m) {
  const double cell_m = work.survey.ground.cell_m;
  const auto first = [&](int at) { return static_cast<int>(std::floor(at * cell_m / side_m)); };
  const auto last = [&](int at) { return static_cast<int>(std::ceil((at + 1) * cell_m / side_m)) - 1; };
  SeenBlocks blocks;
  for (const SurveyCell& cell : work.survey.cells) {
    const auto fresh = std::lower_bound(cell.views.begin(), cell.views.end(), static_cast<int32_t>(work.views_of_base));
    if (fresh == cell.views.end()) continue;
    for (int y = first(cell.y); y <= last(cell.y); ++y) {
      for (int x = first(cell.x); x <= last(cell.x); ++x) {
        SeenBlock& seen = blocks[{y, x}];
        seen.views.insert(fresh, cell.views.end());
        seen.seen_m2 = std::min(seen.seen_m2 + cell_m * cell_m, side_m * side_m);
      }
    }
  }
  return blocks;
}

PlannedTask CompareTask(const ChangeWork& work, const CellRect& cells, const SeenBlock& seen, double change_cell_m,
                        std::set<size_t>* tiles_near) {
  const double cell_m = work.survey.ground.cell_m, margin_m = kBlockMargin * change_cell_m + cell_m;
  CompareParameters parameters;
  parameters.cells = cells;
  parameters.views.assign(seen.views.begin(), seen.views.end());
  PlannedTask task;
  task.kind = kCompareKind;
  task.name = absl::StrCat("compare block ", cells.x0 / kBlockCells, " ", cells.y0 / kBlockCells);
  task.inputs = {{work.base_from, kCityFile}, {work.survey_from, kPlainSurveyFile}};
  double pixels = 0;
  for (const int32_t v : parameters.views) {
    task.view_files.Edit().insert(task.view_files->end(), work.files_of_view[v].begin(), work.files_of_view[v].end());
    if (work.classified[v]) task.inputs.push_back(*work.classified[v]);
    const PinholeCamera& k = work.survey.views[v].camera.intrinsics;
    pixels += static_cast<double>(k.width) * k.height;
  }
  for (size_t t = 0; t < work.tiles.size(); ++t) {
    const CellRect& core = work.tiles[t].parameters.core;
    if (core.x1 * cell_m < cells.x0 * change_cell_m - margin_m ||
        core.x0 * cell_m > cells.x1 * change_cell_m + margin_m ||
        core.y1 * cell_m < cells.y0 * change_cell_m - margin_m ||
        core.y0 * cell_m > cells.y1 * change_cell_m + margin_m) {
      continue;
    }
    parameters.states.push_back(work.tiles[t].parameters.tile);
    task.inputs.push_back(work.tiles[t].before);
    tiles_near->insert(t);
  }
  task.parameters = ToJson(parameters);
  SetCost(PredictCompare(work.survey, pixels, seen.seen_m2 / (change_cell_m * change_cell_m)), &task);
  return task;
}

}  // namespace

std::vector<PlannedTask> PlanChanges(const ChangeWork& work) {
  const double change_cell_m = ChangeCellSize_m(work.survey.gsd_m);
  std::vector<PlannedTask> tasks;
  PlannedTask report;
  ChangesParameters parameters;
  parameters.scene_name = work.survey.scene_name;
  report.kind = report.name = kChangesKind;
  report.inputs = {{work.city_from, kCityFile}, {work.survey_from, kPlainSurveyFile}};
  std::set<size_t> tiles_near;
  for (const auto& [at, seen] : BlocksThatNewViewsSee(work, kBlockCells * change_cell_m)) {
    const auto& [y, x] = at;
    const CellRect cells = {x * kBlockCells, y * kBlockCells, (x + 1) * kBlockCells, (y + 1) * kBlockCells};
    report.inputs.push_back({TaskId(static_cast<int>(work.first_task + tasks.size())), ChangeBlockFile(cells)});
    parameters.blocks.push_back(cells);
    tasks.push_back(CompareTask(work, cells, seen, change_cell_m, &tiles_near));
  }
  if (tasks.empty()) return tasks;
  for (const size_t t : tiles_near) {
    if (!work.tiles[t].after) continue;
    parameters.states.push_back(work.tiles[t].parameters.tile);
    report.inputs.push_back(*work.tiles[t].after);
  }
  if (work.outdated) report.inputs.push_back(*work.outdated);
  parameters.outdated = work.outdated.has_value();
  report.parameters = ToJson(parameters);
  SetCost(PredictChanges(work.survey, static_cast<double>(parameters.blocks.size())), &report);
  tasks.push_back(std::move(report));
  return tasks;
}

}  // namespace tessera
