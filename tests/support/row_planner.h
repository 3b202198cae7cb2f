// A planner of a row of tiles that exchange states, for tests of the coordinator.
#pragma once

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "server/plan/crop_tasks.h"
#include "tests/support/fake_coordinator.h"

namespace tessera {

// A row of tiles with `steps` solve tasks each, which read the last states of the adjacent tiles. A quarantined tile
// has no tasks from its failed one on; the others read its last state.
class RowPlanner : public FakePlanner {
 public:
  RowPlanner() { exchange = true; }
  int steps = 3;
  int first_fine = 0;           // first step after the second split; 0: none
  bool crops = false;           // the solve tasks read a crop of all tiles; a task a tile once it has failed
  std::vector<CellRect> cores;  // of the tiles, in the parameters of their cuts; none: parameters as FakePlanner

  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>& scene_files, const UpdateBase* base,
                                           const FinePart* fine) override {
    if (fine != nullptr) return FineCuts(settings.tiles, *fine);
    TESSERA_ASSIGN_OR_RETURN(std::vector<PlannedTask> tasks,
                             FakePlanner::Tiles(settings, survey, scene_files, base, fine));
    for (size_t tile = 0; tile < tasks.size() && !cores.empty(); ++tile) {
      CutParameters parameters;
      parameters.tile = {static_cast<int>(tile), cores[tile]};
      parameters.cores = cores;
      tasks[tile].parameters = ToJson(parameters);
    }
    return tasks;
  }

  StatusOr<std::vector<PlannedTask>> Steps(const JobSettings& settings, const std::string&,
                                           const std::vector<std::string>&, const std::vector<TileReads>&,
                                           const UpdateBase*, const std::vector<FailedTile>& quarantined,
                                           const FinePart* fine) override {
    const int tiles = settings.tiles, cut_first = fine == nullptr ? 1 : fine->first_task;
    const int first = cut_first + (fine == nullptr ? tiles : static_cast<int>(FineCuts(tiles, *fine).size()));
    const int begin = fine == nullptr ? 0 : first_fine, end = fine == nullptr && first_fine > 0 ? first_fine : steps;
    std::vector<int> ends(tiles, steps);
    for (const FailedTile& each : quarantined) ends[each.tile] = std::max(0, each.step);
    std::vector<PlannedTask> tasks;
    std::vector<PlannedInput> states;
    for (int tile = 0; tile < tiles; ++tile) {
      states.push_back(fine == nullptr ? PlannedInput{TaskId(0), "mesh", tile}
                                       : PlannedInput{fine->split, kMovedFile, tile});
    }
    std::vector<TaskId> crop_of(tiles);
    if (crops) {
      tasks = Crops(tiles, quarantined);
      for (size_t t = 0; t < tasks.size(); ++t) {
        for (const auto& [tile, crop] : CropsByTile(tasks[t], TaskId(first + static_cast<int>(t))))
          crop_of[tile] = crop;
      }
    }
    for (int step = begin; step < end; ++step) {
      std::vector<PlannedInput> made = states;
      for (int tile = 0, cut = cut_first - 1; tile < tiles; ++tile) {
        if (fine == nullptr || !IsLeftOut(*fine, tile)) ++cut;
        if (step >= ends[tile]) continue;
        StepParameters parameters;
        parameters.step = step;
        parameters.tile.tile = tile;
        PlannedTask task{
            kSolveKind, "solve tile " + std::to_string(tile) + " step " + std::to_string(step), tile, "", 1, {}};
        task.inputs.push_back({TaskId(cut), kTileFile});
        if (crops) task.inputs.push_back({crop_of[tile], kViewsFile});
        for (int other = std::max(0, tile - 1); other < std::min(tiles, tile + 2); ++other) {
          task.inputs.push_back(states[other]);
          if (step >= ends[other]) parameters.frozen.push_back(other);
        }
        task.parameters = ToJson(parameters);
        made[tile] = {TaskId(first + static_cast<int>(tasks.size())), kStateFile, tile};
        tasks.push_back(std::move(task));
      }
      states = std::move(made);
    }
    PlannedTask last{kPublishKind, "publish", -1, "{}", 1, {}};
    if (end < steps) {
      last = {kSplitKind, "split", -1, "{}", 1, {}};
      last.later_cost = tiles * (1.0 + steps - end);
    }
    last.inputs.assign(states.begin(), states.end());
    tasks.push_back(std::move(last));
    return tasks;
  }

 private:
  static std::vector<PlannedTask> Crops(int tiles, const std::vector<FailedTile>& quarantined) {
    std::vector<int> all;
    bool failed = false;
    for (int tile = 0; tile < tiles; ++tile) {
      const auto is_crop_of = [&](const FailedTile& each) { return each.tile == tile && each.kind == kCropKind; };
      const bool of_tile = std::any_of(quarantined.begin(), quarantined.end(), is_crop_of);
      failed = failed || of_tile;
      if (!of_tile) all.push_back(tile);
    }
    std::vector<PlannedTask> tasks;
    if (!failed) return {{kCropKind, "crop all tiles", 0, ToJson(CropParameters{all}), 1, {}}};
    for (const int tile : all) {
      tasks.push_back({kCropKind, "crop tile " + std::to_string(tile), tile, ToJson(CropParameters{{tile}}), 1, {}});
    }
    return tasks;
  }
  static bool IsLeftOut(const FinePart& fine, int tile) {
    return std::find(fine.left_out.begin(), fine.left_out.end(), tile) != fine.left_out.end();
  }
  static std::vector<PlannedTask> FineCuts(int tiles, const FinePart& fine) {
    std::vector<PlannedTask> tasks;
    for (int tile = 0; tile < tiles; ++tile) {
      if (IsLeftOut(fine, tile)) continue;
      const std::string number = std::to_string(tile);
      tasks.push_back({kCutKind, "cut tile " + number + " again", tile, "{\"again\":" + number + "}", 1,
                       {{fine.split, kCityFile}}});
    }
    return tasks;
  }
};

}  // namespace tessera
