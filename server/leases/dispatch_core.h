// The state that a coordinator's classes share: ledger, leases, waiting calls and journal, under one mutex.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <mutex>
#include <string>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/storage/blob_store.h"
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
  double lease_s = 30;  // a lease ends that long after its last heartbeat
  // If leases are not checked for longer than this, the coordinator itself stood still (a suspended machine). That time
  // does not count as silence of any worker. Tesserad checks a few times per lease.
  double stood_still_s = std::numeric_limits<double>::infinity();
  double forget_worker_s = 90;  // a silent worker without a task is forgotten after that
  double stall_s = 600;         // an attempt without progress for so long is ended; longer for tasks that take long
  double durable_wait_s = 20;   // a call whose change is not durable after that is answered with UNAVAILABLE
  RetryOptions retry;
  JobLimits limits;
  WorkerLimits worker_limits;
};

// What a coordinator uses. All of it must outlive the coordinator. Callbacks may be empty.
struct DispatchEnvironment {
  RecordStore* store = nullptr;
  BlobStore* blobs = nullptr;
  Planner* planner = nullptr;
  Clock* clock = nullptr;
  // Called for every change once it is stored, in order, by one thread. For logs. Must be quick and not call back.
  std::function<void(const v1::Record&, const ChangedTask&)> on_change;
  // Called for every stored record that Open quarantines.
  std::function<void(int64_t number, const std::string& reason)> on_record_quarantined = {};
  // Called when the journal fails to write, with the reason; with OK when it writes again.
  std::function<void(const Status& trouble)> on_trouble = {};
  // Called for every worker that is suspended. As on_change.
  std::function<void(const SuspendedWorker& worker)> on_worker_suspended = {};
};

// A change is checked and applied in memory under the mutex; the journal stores it in batches. No file is read or
// written, nothing hashed and nothing planned under the mutex. Leases alone survive no failure of the machine: reports
// of their workers are refused then, and the tasks are leased again.
//
// Order of locks: PlanningLoop's, blob_use().mutex, mutex(). What is marked (M) needs mutex() held; all else is
// thread-safe.
class DispatchCore {
 public:
  DispatchCore(const DispatchEnvironment& environment, const DispatchOptions& options);
  DispatchCore(const DispatchCore&) = delete;
  DispatchCore& operator=(const DispatchCore&) = delete;

  const DispatchEnvironment& environment() const { return environment_; }
  const DispatchOptions& options() const { return options_; }
  std::mutex& mutex() { return mutex_; }
  // Its mutex is held shared while a change comes to refer to blobs that may be stored already.
  BlobUse& blob_use() { return blob_use_; }
  Ledger& ledger() { return ledger_; }                // (M)
  LeaseTable& lease_table() { return lease_table_; }  // (M)
  WaitingWorkers& waiting() { return waiting_; }      // (M)
  DispatchCounts& counts() { return counts_; }        // (M)
  Journal& journal() { return journal_; }

  // (M) Checks the record, applies it, queues it for the journal, and wakes workers for tasks that became ready. Errors
  // are those of the check: nothing changed then. Sets the record's time unless it has one.
  Status Commit(v1::Record& record, Durability durability = Durability::kMachine);
  // (M) False if the job's last end is not durable yet.
  bool EndIsStored(int job) const;
  // Waits until all changes so far are durable. UNAVAILABLE if that takes too long: the changes stand.
  Status Durable() const { return journal_.Wait(journal_.last()); }

  // (M) Something that is shown has changed: ends WaitForChange.
  void Changed();
  // Waits until the version is above `seen`, Stop is called or `seconds` of real time have passed. Returns the version,
  // which starts at 1 and grows with every change of what is shown.
  int64_t WaitForChange(int64_t seen, double seconds) const;

  // From now on no job is accepted and nothing is leased: UNAVAILABLE, Refusal::kDraining. Leased tasks continue.
  void Drain();
  bool draining() const { return draining_; }
  // Ends all waits, now and later.
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
  std::map<int, int64_t> end_records_;  // of jobs that ended: the record's number in the journal
  std::atomic<bool> draining_ = false, stopped_ = false;
  ChangedTasks changed_tasks_;  // of what the journal has yet to store
  Journal journal_;             // ends first
};

// Wakes waiting workers for `more` ready tasks: for those in newly_ready() from index `first` on, the worker that has
// the task's tile in memory. Needs the core's mutex.
void WakeWorkers(DispatchCore& core, int more, size_t first);

}  // namespace tessera
