// A tile of a job for display: its state, cost and reasons. Plain values.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "server/leases/lease_table.h"
#include "server/ledger/ledger.h"

namespace tessera {

// Has the numbers of tessera.v1.TileState.
enum class TileProgress {
  kWaiting = 1,
  kReady = 2,
  kRunning = 3,
  kDone = 4,
  kFailed = 5,
  kQuarantined = 6,
  kCancelled = 7,
  kKept = 8
};

inline constexpr size_t kMaxTileReasons = 10, kMaxReasonBytes = 1 << 10, kMaxWaitsFor = 100;

struct TileStatus {
  int tile = -1;
  TileProgress state = TileProgress::kWaiting;
  int attempts = 0, failed_attempts = 0;                // of all its tasks
  double core_seconds = 0, predicted_core_seconds = 0;  // used by tasks that succeeded; predicted of all
  int64_t peak_bytes = 0, predicted_peak_bytes = 0;     // largest of a task; 0: unknown
  double progress = 0;                                  // in [0, 1], by predicted cost
  int tasks_total = 0, tasks_done = 0, tasks_reused = 0;
  // The task that runs, else that failed permanently, else that comes next. Empty if the tile is done or kept.
  std::string task, title, worker, stage;
  std::vector<std::string> reasons;  // errors of `task`, newest first, then why it waits; at most kMaxTileReasons
  std::vector<int> waits_for;        // tiles whose results `task` waits for, ascending; at most kMaxWaitsFor
  std::string last_stats;            // statistics (JSON) of its last task, if all have succeeded
};

// The leased task of each tile of a job, for StatusOfTile.
std::map<int, TaskRef> RunningByTile(const Ledger& ledger, int job, const LeaseTable& leases);

// The status of a tile that JobTotals::tiles has. `running`: RunningByTile; `job_waits_for`: why no task of the job
// runs (WaitingFor). Visits the inputs of one task, and each task of the tile at most once over all calls. Needs the
// core's mutex.
TileStatus StatusOfTile(const Ledger& ledger, int job, int tile, const LeaseTable& leases,
                        const std::map<int, TaskRef>& running, const std::string& job_waits_for);

}  // namespace tessera
