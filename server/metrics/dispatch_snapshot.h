// The state of a coordinator in numbers, for its metrics.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <vector>

#include "server/demand/demand.h"
#include "server/ledger/dispatch_counts.h"
#include "server/ledger/task_groups.h"
#include "server/store/journal.h"

namespace tessera {

class DispatchCore;

struct DispatchSnapshot {
  DispatchCounts counts;
  // Tasks that could be leased now: of jobs that are neither paused nor held.
  std::map<TaskGroup, int64_t> ready;
  double oldest_ready_s = 0;        // how long the one that has waited longest has been ready
  std::vector<ClassDemand> wanted;  // of DefaultClasses
  int64_t delayed = 0;              // that are to be tried again after a while
  int64_t unfinished = 0;           // of jobs that have not ended, as far as they are planned
  std::array<int64_t, kTaskKindSlots> leases = {};
  int64_t workers_working = 0, workers_idle = 0, workers_suspended = 0;  // each in one
  int64_t workers_silent = 0;  // not heard of for as long as a lease lives; forgotten after a while
  int64_t jobs_queued = 0, jobs_running = 0, jobs_paused = 0;  // each in one
  int64_t jobs_held = 0;                                       // of these, those for which the disk has no room
  JournalStats journal;
  bool can_store = true;
};

// Takes no longer for more tasks. Counts are since the coordinator was opened.
DispatchSnapshot SnapshotOf(DispatchCore& core);

}  // namespace tessera
