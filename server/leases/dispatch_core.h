// The state shared by the coordinator's classes: ledger, leases, waiting calls and journal, under one mutex.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/storage/blob_store.h"
#include "common/storage/hash.h"
#include "server/leases/job_limits.h"
#include "server/leases/lease_table.h"
#include "server/leases/retry_rule.h"
#include "server/leases/waiting_workers.h"
#include "server/leases/worker_evidence.h"
#include "server/ledger/blob_references.h"
#include "server/ledger/changed_task.h"
#include "server/ledger/dispatch_counts.h"
#include "server/ledger/ledger.h"
#include "server/store/journal.h"
#include "server/store/record_store.h"

namespace tessera {

class Planner;

struct DispatchOptions {
  double lease_s = 30;  // a lease expires this long after its last heartbeat
  // A longer gap between two checks of leases means that the system did not run the coordinator (a suspended machine).
  // Such a gap does not count as silence of a worker. Tesserad checks a few times per lease.
  double max_check_gap_s = std::numeric_limits<double>::infinity();
  double forget_worker_s = 90;  // a silent worker without a task is removed after this
  double stall_s = 600;         // an attempt without progress is ended after this; see StallLimit_s
  double durable_wait_s = 20;   // a call returns UNAVAILABLE if its change is not durable after this
  RetryOptions retry;
  JobLimits limits;
  WorkerLimits worker_limits;
};

// Dependencies of a coordinator. All must outlive it. Callbacks may be empty.
struct DispatchEnvironment {
  RecordStore* store = nullptr;
  BlobStore* blobs = nullptr;
  Planner* planner = nullptr;
  Clock* clock = nullptr;
  // Called by one thread for each stored change, in order, for the log. Must be quick and not call the coordinator.
  std::function<void(const v1::Record&, const ChangedTask&)> on_change;
  // Called for each record that Open quarantines.
  std::function<void(int64_t number, const std::string& reason)> on_record_quarantined = {};
  // Called with the reason when writing the journal fails, and with OK when it works again.
  std::function<void(const Status& trouble)> on_trouble = {};
  // Called for each suspended worker. Same rules as on_change.
  std::function<void(const SuspendedWorker& worker)> on_worker_suspended = {};
  // Hashes a file of a scene. Its errors are those of a missing or changed file, but for UNAVAILABLE, an outage.
  std::function<StatusOr<Digest>(const std::string& path)> hash_scene_file = [](const std::string& path) {
    return HashFile(path);
  };
  // Called once if another coordinator has taken over the state. No change is acknowledged afterwards.
  std::function<void(const Status& reason)> on_taken_over = {};
};

// A change is checked and applied in memory under the mutex; the journal stores it in batches. Calls of the blob store,
// hashing and planning happen outside the mutex, and not in threads that answer callers: a store may answer late.
// Leases may be lost if the machine fails: reports of their workers are then refused, and the tasks are leased again.
//
// Lock order: PlanningLoop's, blob_use().mutex, mutex(). Members marked (M) need mutex(); all others are thread-safe.
class DispatchCore {
 public:
  DispatchCore(const DispatchEnvironment& environment, const DispatchOptions& options);
  DispatchCore(const DispatchCore&) = delete;
  DispatchCore& operator=(const DispatchCore&) = delete;

  const DispatchEnvironment& environment() const { return environment_; }
  const DispatchOptions& options() const { return options_; }
  std::mutex& mutex() { return mutex_; }
  // Hold its mutex shared while a change adds references to blobs that were stored before.
  BlobUse& blob_use() { return blob_use_; }
  Ledger& ledger() { return ledger_; }                // (M)
  LeaseTable& lease_table() { return lease_table_; }  // (M)
  WaitingWorkers& waiting() { return waiting_; }      // (M)
  DispatchCounts& counts() { return counts_; }        // (M)
  // (M) Tasks that are not leased until their known results are checked (known_results.h).
  std::vector<TaskRef>& set_aside() { return set_aside_; }
  Journal& journal() { return journal_; }

  // (M) Checks the record, applies it, queues it for the journal, and wakes workers for new ready tasks. Sets the
  // record's time unless it has one. On an error of CheckRecord nothing changes.
  Status Commit(v1::Record& record, Durability durability = Durability::kMachine);
  // (M) False only while the record of the job's latest end is not durable.
  bool EndIsStored(int job) const;
  // Waits until all changes so far are durable. UNAVAILABLE after durable_wait_s; the changes stay applied.
  Status Durable() const { return journal_.Wait(journal_.last()); }

  // (M) Call after a change of displayed state: ends WaitForChange.
  void Changed();
  // Waits until the version of the displayed state exceeds `seen`, Stop is called or `seconds` of real time pass.
  // Returns the version, which starts at 1 and grows with every change.
  int64_t WaitForChange(int64_t seen, double seconds) const;

  // Refuses new jobs and leases from now on (UNAVAILABLE, Refusal::kDraining). Leased tasks continue.
  void Drain();
  bool draining() const { return draining_; }
  // Ends all present and future waits.
  void Stop();
  bool stopped() const { return stopped_; }

 private:
  const DispatchEnvironment environment_;
  const DispatchOptions options_;
  BlobUse blob_use_;
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;  // of version_
  int64_t version_ = 1;
  WaitingWorkers waiting_;
  Ledger ledger_;
  LeaseTable lease_table_;
  DispatchCounts counts_;
  std::vector<TaskRef> set_aside_;
  std::map<int, int64_t> end_records_;  // by ended job: number of its record in the journal
  std::atomic<bool> draining_ = false, stopped_ = false;
  ChangedTasks changed_tasks_;  // of records not yet stored
  Journal journal_;             // last: destroyed first
};

// Wakes waiting workers for `more` new ready tasks. A task in newly_ready() from index `first` on wakes the worker that
// has its tile in memory. Needs the core's mutex.
void WakeWorkers(DispatchCore& core, int more, size_t first);

}  // namespace tessera
