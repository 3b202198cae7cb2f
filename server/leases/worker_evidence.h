// Which workers are suspended: they get no tasks for some time.
//
// A worker that reports an unusable scratch folder is suspended at once; so is one that fails tasks which other workers
// then do. It gets a task again after some time. If that fails too, it is suspended for twice as long; a task that it
// does ends this. Nothing of it is stored.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "server/leases/lease_table.h"
#include "server/leases/retry_rule.h"

namespace tessera {

// A worker that was suspended, for the log.
struct SuspendedWorker {
  std::string worker;
  std::string reason;
  double for_s = 0;
};

// Whether the worker gets no tasks at `now_us` (Clock::MonotonicUs).
bool IsSuspended(const WorkerState& worker, int64_t now_us);

// Whether the worker may be given the task: not if it failed it and another one that is there, and not suspended, has
// not yet.
bool MayTry(const JobTask& task, const std::string& worker, const LeaseTable& leases, int64_t now_us);

// What JudgeFailure needs to know about the workers of `task`, whose last attempt has just ended.
Witnesses WitnessesOf(const JobTask& task, const LeaseTable& leases, const RetryOptions& options, int64_t now_us);

// Notes how the last attempt of the task ended. Returns the workers that are suspended for it.
std::vector<SuspendedWorker> NoteFailure(const JobTask& task, const TaskFailure& failure, const RetryOptions& options,
                                         int64_t now_us, LeaseTable& leases);
std::vector<SuspendedWorker> NoteSuccess(const JobTask& task, const std::string& worker, const RetryOptions& options,
                                         int64_t now_us, LeaseTable& leases);

}  // namespace tessera
