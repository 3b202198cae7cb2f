// Suspension of workers that fail tasks: they get no tasks for some time.
//
// A worker is suspended if its scratch folder is unusable, or if it fails tasks that other workers then complete. If it
// fails again after the suspension, the next one is twice as long; a success resets it. This state is not stored.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "server/leases/lease_table.h"
#include "server/leases/retry_rule.h"

namespace tessera {

// A suspended worker, for the log.
struct SuspendedWorker {
  std::string worker;
  std::string reason;
  double for_s = 0;
};

// `now_us`: Clock::MonotonicUs.
bool IsSuspended(const WorkerState& worker, int64_t now_us);

// Whether the worker may get the task. A worker that failed it must wait if an active, not suspended worker has not yet
// failed it.
bool MayTry(const JobTask& task, const std::string& worker, const LeaseTable& leases, int64_t now_us);

// Evidence for DecideAfterFailure about the workers of `task`, whose last attempt has just ended.
OtherWorkers OtherWorkersOf(const JobTask& task, const LeaseTable& leases, const RetryOptions& options, int64_t now_us);

// Record the end of the task's last attempt. Return the workers suspended for it.
std::vector<SuspendedWorker> NoteFailure(const JobTask& task, const TaskFailure& failure, const RetryOptions& options,
                                         int64_t now_us, LeaseTable& leases);
std::vector<SuspendedWorker> NoteSuccess(const JobTask& task, const std::string& worker, const RetryOptions& options,
                                         int64_t now_us, LeaseTable& leases);

}  // namespace tessera
