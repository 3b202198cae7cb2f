// What ends an attempt, and whether it is the current one. All functions need the core's mutex.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/leases/dispatch_core.h"

namespace tessera {

// Notes that the worker called. Refusal::kUnknownWorker if it is not registered.
Status MarkSeen(DispatchCore& core, const std::string& worker);
// Errors with Refusal::kNotCurrent.
StatusOr<TaskRef> FindReported(DispatchCore& core, const std::string& task);
Status CheckCurrent(DispatchCore& core, TaskRef ref, const std::string& worker, int attempt);

// Ends the current attempt. The retry rule decides whether the task is tried again, and whether a worker is suspended.
Status FailAttempt(DispatchCore& core, TaskRef ref, const TaskFailure& failure);
// The same with a verdict that is known.
Status EndAttempt(DispatchCore& core, TaskRef ref, const RetryVerdict& verdict, bool lease_expired);
// Counts suspended workers and calls on_worker_suspended.
void ReportSuspended(DispatchCore& core, const std::vector<SuspendedWorker>& workers);

}  // namespace tessera
