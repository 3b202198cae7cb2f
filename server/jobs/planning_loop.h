// The planning loop: plans and ends jobs, reuses known results, and admits held jobs.
#pragma once

#include <atomic>
#include <mutex>

#include "common/base/status.h"
#include "server/jobs/pending_step.h"
#include "server/jobs/recovery.h"
#include "server/jobs/waiting_for.h"
#include "server/leases/dispatch_core.h"
#include "server/leases/work_thread.h"

namespace tessera {

// Takes the pending steps of all jobs. Thread-safe.
class PlanningLoop {
 public:
  // Both must outlive this.
  PlanningLoop(DispatchCore& core, Recovery& recovery) : core_(core), recovery_(recovery) {}

  // Takes all pending steps. If another thread is in this function, that thread takes them and this call returns at
  // once. Errors of storage; the next call retries.
  Status Advance();
  // Calls Advance in a background thread.
  void AdvanceSoon();
  // The error of the last such call that has ended.
  Status background_status() const;
  // Disk space at the last check. Needs the core's mutex.
  const Room& room() const { return room_; }

 private:
  Status PlanJob(const PendingStep& step);
  Status QuarantineTile(const PendingStep& step);
  Status EndJob(PendingStep step);
  // Completes ready tasks that have a known result.
  void ReuseReady();
  // --- admit_held.cc ---
  // Admits held jobs whose predicted output fits the disk beside that of running jobs.
  void AdmitHeld();

  DispatchCore& core_;
  Recovery& recovery_;
  const DispatchEnvironment& environment_ = core_.environment();
  std::mutex& mutex_ = core_.mutex();
  Ledger& ledger_ = core_.ledger();
  LeaseTable& leases_ = core_.lease_table();
  Journal& journal_ = core_.journal();
  std::atomic<bool> advance_wanted_ = false;
  std::mutex advance_mutex_;  // one Advance at a time; lock order: before the core's
  Room room_;
  Status background_status_;  // guarded by the core's mutex
  std::atomic<bool> advance_soon_ = false;
  WorkThread advance_thread_;  // last: destroyed first
};

}  // namespace tessera
