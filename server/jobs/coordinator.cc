// Start of a coordinator: restores the state from the records and handles unusable ones.
#include "server/jobs/coordinator.h"

#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/base/version.h"
#include "server/jobs/job_records.h"
#include "server/leases/attempts.h"
#include "server/ledger/check_record.h"
#include "server/ledger/record_owner.h"
#include "server/ledger/restore_ledger.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

Status EndSpoiledJob(DispatchCore& core, int job, const std::string& error) {
  if (job >= static_cast<int>(core.ledger().jobs().size())) {  // its acceptance record is lost
    v1::Record record;
    record.mutable_job_accepted()->set_job(JobName(job));
    if (!CheckRecord(core.ledger(), record).ok()) return absl::OkStatus();  // the job number is not plausible
    TESSERA_RETURN_IF_ERROR(core.Commit(record));
  }
  if (HasEnded(core.ledger().jobs()[job].header.state)) return absl::OkStatus();
  return CommitEnd(core, job, JobState::kFailed, error + "; submit it again", {});
}

Status Replay(DispatchCore& core) {
  std::vector<std::pair<int64_t, std::string>> unusable;
  std::map<int, std::string> spoiled;  // reason by job
  TESSERA_RETURN_IF_ERROR(RestoreLedger(*core.environment().store, core.ledger(),
                                        [&](int64_t number, const Status& status, const v1::Record& record) {
                                          const std::string reason(status.message());
                                          unusable.emplace_back(number, reason);
                                          const int job = JobOf(record);
                                          if (job < 0) return;
                                          spoiled.emplace(job, "stored record " + std::to_string(number) +
                                                                   " cannot be used: " + reason);
                                        })
                              .status());
  core.ledger().ready().Promote(core.environment().clock->MonotonicUs());  // starts retry delays again
  for (const auto& [job, error] : spoiled) TESSERA_RETURN_IF_ERROR(EndSpoiledJob(core, job, error));
  // Quarantine last, so that an interrupted start repeats the same steps.
  TESSERA_RETURN_IF_ERROR(core.Durable());
  for (const auto& [number, reason] : unusable) {
    TESSERA_RETURN_IF_ERROR(core.environment().store->Quarantine(number, reason));
    if (core.environment().on_record_quarantined) core.environment().on_record_quarantined(number, reason);
  }
  return absl::OkStatus();
}

// Restarts active jobs of other algorithm versions, and gives up recomputing results of these versions.
Status RestartJobsOfOtherVersions(DispatchCore& core) {
  const auto of_another = [&](int job) { return !core.ledger().CheckVersion(job, "").ok(); };
  const std::vector<int> active = core.ledger().active_jobs();
  for (const int job : active) {
    if (!of_another(job)) continue;
    v1::Record record;
    record.mutable_job_restarted()->set_job(JobName(job));
    record.mutable_job_restarted()->set_algorithm_version(kAlgorithmVersion);
    TESSERA_RETURN_IF_ERROR(core.Commit(record));
  }
  // Ended jobs of other versions cannot recompute results with this version, so these tasks fail.
  const std::set<TaskRef> remakes = core.ledger().remakes_of_ended();
  for (const TaskRef ref : remakes) {
    const JobTask& task = core.ledger().task(ref);
    if (!of_another(ref.job) || !task.remaking) continue;
    if (task.state == TaskState::kReady) {
      v1::Record record;
      record.mutable_attempt_started()->set_task(TaskName(ref));
      record.mutable_attempt_started()->set_attempt(task.attempt() + 1);
      TESSERA_RETURN_IF_ERROR(core.Commit(record));
    }
    if (task.state != TaskState::kLeased) continue;  // it fails with the task that it waits for
    const Status reason = core.ledger().CheckVersion(ref.job, "it cannot be recomputed");
    TESSERA_RETURN_IF_ERROR(
        EndAttempt(core, ref, {true, 0, {ErrorClass::kStorage, std::string(reason.message())}}, false));
  }
  return absl::OkStatus();
}

// Gives each leased task a lease of full term.
void RestoreLeases(DispatchCore& core) {
  const Ledger& ledger = core.ledger();
  const int64_t now_us = core.environment().clock->MonotonicUs();
  const auto restore = [&](TaskRef ref) {
    const JobTask& task = ledger.task(ref);
    if (task.state != TaskState::kLeased) return;
    if (core.lease_table().FindWorker(task.worker()) == nullptr) {
      WorkerInfo info;
      info.machine = task.attempts.back().machine;
      core.lease_table().AddWorker(task.worker(), info, now_us);
      WorkerState& restored = *core.lease_table().FindWorker(task.worker());
      restored.has_called = false;
      restored.is_restored = true;
    }
    core.lease_table().Grant(ref,
                             {task.worker(), task.attempt(), now_us, now_us + Micros(core.options().lease_s), now_us});
  };
  for (const int job : ledger.active_jobs()) {
    for (int i = 0; i < static_cast<int>(ledger.jobs()[job].tasks.size()); ++i) restore({job, i});
  }
  for (const TaskRef ref : ledger.remakes_of_ended()) restore(ref);
}

}  // namespace

Coordinator::Coordinator(const DispatchEnvironment& environment, const DispatchOptions& options)
    : core_(environment, options),
      leases_(core_,
              {[this](const std::string& worker, const std::string& task, int attempt, const TaskFailure& failure) {
                 return recovery_.ReportLostInputs(worker, task, attempt, failure);
               },
               [this] { planning_.AdvanceSoon(); }}) {}

StatusOr<std::unique_ptr<Coordinator>> Coordinator::Open(const DispatchEnvironment& environment,
                                                         const DispatchOptions& options) {
  std::unique_ptr<Coordinator> coordinator(new Coordinator(environment, options));
  TESSERA_RETURN_IF_ERROR(Replay(coordinator->core_));
  TESSERA_RETURN_IF_ERROR(RestartJobsOfOtherVersions(coordinator->core_));
  RestoreLeases(coordinator->core_);
  return coordinator;
}

Status Coordinator::QuarantineUnusable(const DispatchEnvironment& environment) {
  DispatchCore core(environment, {});
  return Replay(core);
}

Status Coordinator::Tick() {
  TESSERA_RETURN_IF_ERROR(leases_.Expire());
  return planning_.Advance();
}

Status Coordinator::TickInBackground() {
  TESSERA_RETURN_IF_ERROR(leases_.Expire());
  planning_.AdvanceSoon();
  return planning_.background_status();
}

}  // namespace tessera
