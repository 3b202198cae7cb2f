// A tile of the task graph (graph.cc).
#pragma once

#include <limits>
#include <optional>

#include "absl/strings/str_cat.h"
#include "server/plan/planned_task.h"

namespace tessera {

// A tile and its planned tasks that other tasks read.
struct GraphTile {
  TileParameters parameters;
  TileWork work;
  TaskId cut, crop;
  std::optional<PlannedInput> sums, state;  // latest outputs
  bool redone = true;                       // false: an update keeps the base's state
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

}  // namespace tessera
