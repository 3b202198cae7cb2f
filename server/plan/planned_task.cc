#include "server/plan/planned_task.h"

namespace tessera {

std::string InputName(const PlannedInput& input) {
  return input.tile < 0 ? input.output.str() : TileInputName(input.tile, input.output);
}

void SetCost(const Prediction& cost, PlannedTask* task) {
  task->cost = cost.core_seconds;
  task->peak_bytes = cost.peak_bytes;
  task->stored_bytes = cost.stored_bytes;
}

}  // namespace tessera
