// Selects a worker's task: one that fits its memory, of the first job, preferably of a tile in its memory.
#pragma once

#include <optional>
#include <string>

#include "server/leases/lease_table.h"
#include "server/ledger/ledger.h"

namespace tessera {

struct Placement {
  std::optional<TaskRef> task;
  // All suitable tasks are of tiles of other workers, and this worker has not waited long enough to take one.
  bool left_to_others = false;
};

// `waited_s`: how long the worker has waited. `now_us`: Clock::MonotonicUs. Starts and ends retry delays.
Placement PlaceTask(Ledger& ledger, LeaseTable& leases, const std::string& worker, double waited_s, int64_t now_us);

}  // namespace tessera
