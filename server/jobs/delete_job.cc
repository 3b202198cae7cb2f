// How jobs go: when a user asks, or when they have been kept for long enough.
#include <utility>

#include "common/base/version.h"
#include "server/jobs/dispatcher.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr int kFreedTasks = 1000, kRemovedRecords = 1000;  // at once: others wait for that long

}  // namespace

Status Dispatcher::DeleteJobLocked(const std::string& name, const std::string& reason) {
  TESSERA_ASSIGN_OR_RETURN(const int job, ParseJobName(name));
  if (ledger_.WasDeleted(job)) return absl::OkStatus();
  v1::Record record;
  record.mutable_job_deleted()->set_job(name);
  record.mutable_job_deleted()->set_reason(reason);
  TESSERA_RETURN_IF_ERROR(CommitLocked(record));
  leases_.DropJob(job);  // of what was being made again
  return absl::OkStatus();
}

Status Dispatcher::DeleteJob(const std::string& name, const std::string& reason) {
  {
    std::lock_guard lock(mutex_);
    TESSERA_RETURN_IF_ERROR(DeleteJobLocked(name, reason));
  }
  return Durable();
}

StatusOr<bool> Dispatcher::FreeDeleted() {
  bool more = false;
  {
    std::lock_guard lock(mutex_);
    more = ledger_.FreeDeleted(kFreedTasks);
  }
  TESSERA_ASSIGN_OR_RETURN(const int removed, environment_.store->RemoveRecords(kRemovedRecords));
  return more || removed > 0;
}

StatusOr<int> Dispatcher::DeleteExpired(Retention& retention) {
  std::vector<KeptThing> ended;
  {
    std::lock_guard lock(mutex_);
    for (int job = 0; job < static_cast<int>(ledger_.jobs().size()); ++job) {
      const JobHeader& header = ledger_.jobs()[job].header;
      if (!ledger_.WasDeleted(job) && HasEnded(header.state)) ended.push_back({header.name, header.end_us});
    }
  }
  const std::vector<int> expired =
      retention.Expired(ended, environment_.clock->UnixTimeUs(), environment_.clock->MonotonicUs());
  int deleted = 0;
  // The newest first: what goes on from a job is newer.
  for (auto place = expired.rbegin(); place != expired.rend(); ++place) {
    const auto& [name, end_us] = ended[*place];
    std::lock_guard lock(mutex_);
    const auto job = ledger_.FindJob(name);
    if (!job.ok() || ledger_.jobs()[*job].header.end_us != end_us) continue;  // it goes on
    const Status status = DeleteJobLocked(name, "kept for long enough");
    if (absl::IsFailedPrecondition(status)) continue;  // another needs it
    TESSERA_RETURN_IF_ERROR(status);
    ++deleted;
  }
  if (deleted > 0) TESSERA_RETURN_IF_ERROR(Durable());
  return deleted;
}

Status Dispatcher::BeginOthersAnew() {
  const auto of_another = [&](int job) { return !ledger_.CheckVersion(job, "").ok(); };
  const std::vector<int> active = ledger_.active_jobs();
  for (const int job : active) {
    if (!of_another(job)) continue;
    v1::Record record;
    record.mutable_job_begun_anew()->set_job(JobName(job));
    record.mutable_job_begun_anew()->set_algorithm_version(kAlgorithmVersion);
    TESSERA_RETURN_IF_ERROR(CommitLocked(record));
  }
  // Nobody waits any more for what ended jobs of another version were asked to make again, and this one cannot.
  const std::set<TaskRef> remakes = ledger_.remakes_of_ended();
  for (const TaskRef ref : remakes) {
    const JobTask& task = ledger_.task(ref);
    if (!of_another(ref.job) || !task.remaking) continue;
    if (task.state == TaskState::kReady) {
      v1::Record record;
      record.mutable_attempt_started()->set_task(TaskName(ref));
      record.mutable_attempt_started()->set_attempt(task.attempt() + 1);
      TESSERA_RETURN_IF_ERROR(CommitLocked(record));
    }
    if (task.state != TaskState::kLeased) continue;  // it waits for another of these
    const Status reason = ledger_.CheckVersion(ref.job, "it cannot be made again");
    TESSERA_RETURN_IF_ERROR(
        EndAttemptLocked(ref, {true, 0, {ErrorClass::kStorage, std::string(reason.message())}}, false));
  }
  return absl::OkStatus();
}

}  // namespace tessera
