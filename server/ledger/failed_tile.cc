#include "server/ledger/failed_tile.h"

#include "common/job/task_parameters.h"

namespace tessera {

FailedTile FailedTileOf(const Job& job, const QuarantinedTile& tile) {
  const PlannedTask& failed = job.tasks[tile.task].plan;
  FailedTile out = {tile.tile, failed.kind};
  if (const auto parameters = ParseStepParameters(failed.parameters); parameters.ok()) {
    out.step = parameters->step;
    out.before = parameters->before;
  }
  out.fine = IsOfFinePart(job, failed);
  return out;
}

}  // namespace tessera
