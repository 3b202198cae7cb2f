#include "server/leases/attempts.h"

#include <utility>

#include "common/base/refusal.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

Status UnknownWorker(const std::string& worker) {
  return Refuse(Refusal::kUnknownWorker, absl::NotFoundError("no such worker: '" + worker + "'; register again"));
}

Status MarkSeen(DispatchCore& core, const std::string& worker) {
  WorkerState* const known = core.lease_table().FindWorker(worker);
  if (known == nullptr) return UnknownWorker(worker);
  known->last_seen_us = core.environment().clock->MonotonicUs();
  known->has_called = true;
  return absl::OkStatus();
}

StatusOr<TaskRef> FindReported(DispatchCore& core, const std::string& task) {
  StatusOr<TaskRef> ref = core.ledger().FindTask(task);
  if (!ref.ok()) return Refuse(Refusal::kNotCurrent, ref.status());
  return ref;
}

Status CheckCurrent(DispatchCore& core, TaskRef ref, const std::string& worker, int attempt) {
  if (core.lease_table().FindCurrent(ref, worker, attempt) != nullptr) return absl::OkStatus();
  return Refuse(Refusal::kNotCurrent,
                absl::FailedPreconditionError(TaskName(ref) + ": attempt " + std::to_string(attempt) + " of " + worker +
                                              " is not the current one"));
}

Status FailAttempt(DispatchCore& core, TaskRef ref, const TaskFailure& failure) {
  const int64_t now_us = core.environment().clock->MonotonicUs();
  const JobTask& task = core.ledger().task(ref);
  const JobTask counted = WithCountedAttempts(task);
  const OtherWorkers others = OtherWorkersOf(counted, core.lease_table(), core.options().retry, now_us);
  TESSERA_RETURN_IF_ERROR(
      EndAttempt(core, ref, DecideAfterFailure(counted, failure, core.options().retry, others), false));
  ReportSuspended(core, NoteFailure(task, failure, core.options().retry, now_us, core.lease_table()));
  return absl::OkStatus();
}

Status EndAttempt(DispatchCore& core, TaskRef ref, const RetryDecision& decision, bool lease_expired) {
  v1::Record record;
  v1::AttemptFailed& failed = *record.mutable_attempt_failed();
  failed.set_task(TaskName(ref));
  failed.set_attempt(core.ledger().task(ref).attempt());
  failed.mutable_error()->set_error_class(static_cast<v1::ErrorClass>(decision.failure.error_class));
  failed.mutable_error()->set_message(decision.failure.message);
  failed.set_final(decision.final);
  failed.set_lease_expired(lease_expired);
  failed.set_retry_delay_us(Micros(decision.delay_s));
  TESSERA_RETURN_IF_ERROR(core.Commit(record));
  core.ledger().ready().Promote(core.environment().clock->MonotonicUs());  // starts the delay
  core.lease_table().Release(ref);
  return absl::OkStatus();
}

void ReportSuspended(DispatchCore& core, const std::vector<SuspendedWorker>& workers) {
  core.counts().CountSuspended(static_cast<int64_t>(workers.size()));
  if (!core.environment().on_worker_suspended) return;
  for (const SuspendedWorker& worker : workers) core.environment().on_worker_suspended(worker);
}

}  // namespace tessera
