// Text for users: why a job makes no progress.
#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "server/leases/lease_table.h"
#include "server/ledger/ledger.h"

namespace tessera {

// Disk space for new jobs, as last measured.
struct Room {
  std::string folder;
  int64_t free_bytes = 0;
  int64_t promised_bytes = 0;  // of these: predicted output of admitted jobs
};

// The reason: pause, disk space, no worker, too little memory, another job first, a retry delay, a running task or the
// journal. Empty if the job has ended or makes progress. `now_us`: Clock::MonotonicUs. Needs the core's mutex.
std::string WaitingFor(const Ledger& ledger, int job, const LeaseTable& leases, const Status& storage_trouble,
                       const Room& room, int64_t now_us);

}  // namespace tessera
