// A planner of a row of tiles that exchange states, for tests of the coordinator.
#pragma once

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/fake_coordinator.h"

namespace tessera {

// A row of tiles with `steps` solve tasks each, which read the last states of the adjacent tiles. A quarantined tile
// has no tasks from its failed one on; the others read its last state.
class RowPlanner : public FakePlanner {
 public:
  RowPlanner() { exchange = true; }
  int steps = 3;
  std::vector<CellRect> cores;  // of the tiles, in the parameters of their cuts; none: parameters as FakePlanner

  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>& scene_files,
                                           const UpdateBase* base) override {
    TESSERA_ASSIGN_OR_RETURN(std::vector<PlannedTask> tasks, FakePlanner::Tiles(settings, survey, scene_files, base));
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
                                           const UpdateBase*, const std::vector<FailedTile>& quarantined) override {
    const int tiles = settings.tiles, first = 1 + tiles;
    std::vector<int> ends(tiles, steps);
    for (const FailedTile& each : quarantined) ends[each.tile] = std::max(0, each.step);
    std::vector<PlannedTask> tasks;
    std::vector<PlannedInput> states;
    for (int tile = 0; tile < tiles; ++tile) states.push_back({TaskId(0), "mesh", tile});
    for (int step = 0; step < steps; ++step) {
      std::vector<PlannedInput> made = states;
      for (int tile = 0; tile < tiles; ++tile) {
        if (step >= ends[tile]) continue;
        StepParameters parameters;
        parameters.step = step;
        parameters.tile.tile = tile;
        PlannedTask task{
            kSolveKind, "solve tile " + std::to_string(tile) + " step " + std::to_string(step), tile, "", 1, {}};
        task.inputs.push_back({TaskId(1 + tile), kTileFile});
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
    PlannedTask publish{kPublishKind, "publish", -1, "{}", 1, {}};
    publish.inputs.assign(states.begin(), states.end());
    tasks.push_back(std::move(publish));
    return tasks;
  }
};

}  // namespace tessera
