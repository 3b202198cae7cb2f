// What the coordinator does by itself, without a worker: plan jobs, take known results, admit and end jobs.
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

// Thread-safe.
class PlanningLoop {
 public:
  // Both must outlive this.
  PlanningLoop(DispatchCore& core, Recovery& recovery) : core_(core), recovery_(recovery) {}

  // Takes all steps that are pending. If another thread is in here, that thread takes them, and this returns at once.
  // Errors are those of the planner's inputs or of storage; the next call tries again.
  Status Advance();
  // Advance, by a thread of its own.
  void AdvanceSoon();
  // The room on the disk as it was last found. Needs the core's mutex.
  const Room& room() const { return room_; }

 private:
  Status PlanJob(const PendingStep& step);
  Status QuarantineTile(const PendingStep& step);
  Status EndJob(PendingStep step);
  // Takes known results of tasks that became ready.
  Status ReuseReady();
  // --- admit_held.cc ---
  // Held jobs begin as soon as what they are predicted to store fits the disk, beside what others store.
  void AdmitHeld();

  DispatchCore& core_;
  Recovery& recovery_;
  const DispatchEnvironment& environment_ = core_.environment();
  std::mutex& mutex_ = core_.mutex();
  Ledger& ledger_ = core_.ledger();
  LeaseTable& leases_ = core_.lease_table();
  Journal& journal_ = core_.journal();
  std::atomic<bool> advance_wanted_ = false;
  std::mutex advance_mutex_;  // one Advance at a time; taken before the core's
  Room room_;
  std::atomic<bool> advance_soon_ = false;
  WorkThread advance_thread_;  // ends first
};

}  // namespace tessera
