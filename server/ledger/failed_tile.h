// What the planner must know of a quarantined tile.
#pragma once

#include "server/ledger/job.h"
#include "server/plan/stages.h"

namespace tessera {

FailedTile FailedTileOf(const Job& job, const QuarantinedTile& tile);

}  // namespace tessera
