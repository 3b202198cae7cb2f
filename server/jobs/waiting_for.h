// Why a job makes no progress, as text.
#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "server/leases/lease_table.h"
#include "server/ledger/ledger.h"

namespace tessera {

// Free disk space for jobs that are to begin, as last measured.
struct Room {
  std::string folder;
  int64_t free_bytes = 0;
  int64_t promised_bytes = 0;  // of these, to jobs that have begun
};

// What the job waits for: to be resumed, disk space, a worker, a worker with more memory, a job of higher rank, the end
// of a retry delay, a running task, the journal. Empty if it has ended, or all its ready tasks run. `now_us`:
// Clock::MonotonicUs.
std::string WaitingFor(const Ledger& ledger, int job, const LeaseTable& leases, const Status& storage_trouble,
                       const Room& room, int64_t now_us);

}  // namespace tessera
