// A tile of the task graph (graph.cc).
#pragma once

#include <algorithm>
#include <iterator>
#include <limits>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/plan/planned_task.h"

namespace tessera {

// A tile and its planned tasks that other tasks read.
struct GraphTile {
  TileParameters parameters;
  TileWork work;
  TaskId cut, crop;
  std::optional<PlannedInput> coarse_crop;  // in the fine part: the crops of the coarse part
  std::optional<PlannedInput> sums, state;  // latest outputs
  bool redone = true;                       // false: an update keeps the base's state
  bool left_out = false;                    // quarantined before the fine part: it is not cut again
  bool crop_failed = false;                 // quarantined, because its images could not be cropped
  // First stage (StageOf) without tasks, because the tile is quarantined; it keeps the state before.
  int frozen_from = std::numeric_limits<int>::max();
  bool never_started() const { return frozen_from < 0; }
  bool gone() const { return parameters.core.empty(); }
  bool Works(int stage) const { return redone && stage < frozen_from; }  // has tasks in this stage
  bool quarantined() const { return redone && !Works(std::numeric_limits<int>::max() - 1); }
};

// A task of the tile, without inputs and parameters.
inline PlannedTask TaskOf(const GraphTile& tile, const char* kind, const Prediction& cost) {
  PlannedTask task;
  task.kind = kind;
  task.tile = tile.parameters.tile;
  task.name = absl::StrCat(kind, " tile ", task.tile);
  SetCost(cost, &task);
  return task;
}

// Adds the tile's crops to the task's inputs.
inline void ReadCrops(const GraphTile& tile, PlannedTask* task) {
  task->inputs.push_back({tile.crop, kViewsFile});
  if (tile.coarse_crop) task->inputs.push_back(*tile.coarse_crop);
}

// The latest states or sums of a tile.
using LatestOutput = std::optional<PlannedInput> GraphTile::*;

// Adds those of the tiles to the task's inputs. Returns the tiles that have one.
inline std::vector<int> ReadLatest(const std::vector<GraphTile>& tiles, LatestOutput latest,
                                   const std::vector<int>& ids, PlannedTask* task) {
  std::vector<int> read;
  for (const int id : ids) {
    const std::optional<PlannedInput>& made = tiles[id].*latest;
    if (!made) continue;
    task->inputs.push_back(*made);
    read.push_back(id);
  }
  return read;
}

// Those of the tiles that have no tasks in the stage.
inline std::vector<int> FrozenOf(const std::vector<GraphTile>& tiles, const std::vector<int>& ids, int stage) {
  std::vector<int> frozen;
  std::copy_if(ids.begin(), ids.end(), std::back_inserter(frozen), [&](int id) { return !tiles[id].Works(stage); });
  return frozen;
}

}  // namespace tessera
