// Why a job does not move, in words.
#ifndef TESSERA_SERVER_JOBS_WAITING_FOR_H_
#define TESSERA_SERVER_JOBS_WAITING_FOR_H_

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "server/leases/lease_table.h"
#include "server/ledger/ledger.h"

namespace tessera {

// What the disk has for jobs that are to begin, as it was last found.
struct Room {
  std::string folder;
  int64_t free_bytes = 0;
  int64_t promised_bytes = 0;  // of these, to jobs that have begun
};

// What the job waits for, for the user: that it is resumed, room on the disk, a worker, one with more memory, a job
// that comes before it, a delay's end, a task that all others wait for, a disk. Empty if it has ended, or all that is
// ready is being done. `now_us`: Clock::MonotonicUs.
std::string WaitingFor(const Ledger& ledger, int job, const LeaseTable& leases, const Status& storage_trouble,
                       const Room& room, int64_t now_us);

}  // namespace tessera

#endif  // TESSERA_SERVER_JOBS_WAITING_FOR_H_
