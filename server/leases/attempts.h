// Checks and ends attempts. All functions need the core's mutex.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/leases/dispatch_core.h"

namespace tessera {

// Refusal::kUnknownWorker: the worker must register again.
Status UnknownWorker(const std::string& worker);
// Records the time of the worker's call. Refusal::kUnknownWorker if it is not registered.
Status MarkSeen(DispatchCore& core, const std::string& worker);
// The reported task, and whether the attempt is the current one. Both fail with Refusal::kNotCurrent.
StatusOr<TaskRef> FindReported(DispatchCore& core, const std::string& task);
Status CheckCurrent(DispatchCore& core, TaskRef ref, const std::string& worker, int attempt);

// Ends the current attempt as failed. The retry rule decides on a retry and on suspending workers.
Status FailAttempt(DispatchCore& core, TaskRef ref, const TaskFailure& failure);
// Ends the current attempt with this decision.
Status EndAttempt(DispatchCore& core, TaskRef ref, const RetryDecision& decision, bool lease_expired);
// Counts suspended workers and calls on_worker_suspended.
void ReportSuspended(DispatchCore& core, const std::vector<SuspendedWorker>& workers);

}  // namespace tessera
