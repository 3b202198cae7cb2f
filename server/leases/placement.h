// Which task a worker gets: one that fits its memory, of the first job, preferably of a tile that the worker has.
#pragma once

#include <optional>
#include <string>

#include "server/leases/lease_table.h"
#include "server/ledger/ledger.h"

namespace tessera {

struct Placement {
  std::optional<TaskRef> task;
  // There are tasks, but other workers have their tiles, and this one has not waited long enough to take one of them.
  bool left_to_keepers = false;
};

// `waited_s`: how long the worker has asked already. `now_us`: Clock::MonotonicUs. Begins and ends delays of retries.
Placement PlaceTask(Ledger& ledger, LeaseTable& leases, const std::string& worker, double waited_s, int64_t now_us);

}  // namespace tessera
