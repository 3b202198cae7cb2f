// How a coordinator starts: the state from its records, whatever has become of some of them.
#include <map>
#include <utility>

#include "server/jobs/dispatcher.h"
#include "server/ledger/read_records.h"
#include "server/ledger/record_owner.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

StatusOr<std::unique_ptr<Dispatcher>> Dispatcher::Open(const DispatchEnvironment& environment,
                                                       const DispatchOptions& options) {
  std::unique_ptr<Dispatcher> dispatcher(new Dispatcher(environment, options));
  TESSERA_RETURN_IF_ERROR(dispatcher->Replay());
  TESSERA_RETURN_IF_ERROR(dispatcher->BeginOthersAnew());
  const Ledger& ledger = dispatcher->ledger_;
  const int64_t now_us = environment.clock->MonotonicUs();
  const auto restore = [&](TaskRef ref) {
    const JobTask& task = ledger.task(ref);
    if (task.state != TaskState::kLeased) return;
    if (dispatcher->leases_.FindWorker(task.worker()) == nullptr) {
      WorkerInfo info;
      info.machine = task.attempts.back().machine;
      dispatcher->leases_.AddWorker(task.worker(), info, now_us);
      dispatcher->leases_.FindWorker(task.worker())->heard = false;
    }
    dispatcher->leases_.Grant(ref, {task.worker(), task.attempt(), now_us, now_us + Micros(options.lease_s), now_us});
  };
  for (const int job : ledger.active_jobs()) {
    for (int i = 0; i < static_cast<int>(ledger.jobs()[job].tasks.size()); ++i) restore({job, i});
  }
  for (const TaskRef ref : ledger.remakes_of_ended()) restore(ref);
  return dispatcher;
}

Status Dispatcher::SetUnusableAside(const DispatchEnvironment& environment) {
  return std::unique_ptr<Dispatcher>(new Dispatcher(environment, {}))->Replay();
}

Status Dispatcher::Replay() {
  std::vector<std::pair<int64_t, std::string>> unusable;
  std::map<int, std::string> spoiled;  // jobs, and why
  TESSERA_ASSIGN_OR_RETURN(std::set<int> deleted, environment_.store->DeletedJobs());
  ledger_.ExpectDeleted(std::move(deleted));
  TESSERA_RETURN_IF_ERROR(
      ReadRecords(*environment_.store, [&](int64_t number, Status status, const v1::Record& record) {
        if (status.ok()) status = ledger_.Check(record);
        if (status.ok()) return ledger_.Apply(record);
        const std::string reason(status.message());
        unusable.emplace_back(number, reason);
        if (const int job = JobOf(record); job >= 0) {
          spoiled.emplace(job, "stored record " + std::to_string(number) + " cannot be used: " + reason);
        }
      }));
  ledger_.EndReplay();
  ledger_.PromoteRetries(environment_.clock->MonotonicUs());  // whole delays begin again
  for (const auto& [job, error] : spoiled) TESSERA_RETURN_IF_ERROR(EndSpoiledJob(job, error));
  // Last: if this start is cut off, the next one finds the same.
  TESSERA_RETURN_IF_ERROR(Durable());
  for (const auto& [number, reason] : unusable) {
    TESSERA_RETURN_IF_ERROR(environment_.store->SetAside(number, reason));
    if (environment_.on_set_aside) environment_.on_set_aside(number, reason);
  }
  return absl::OkStatus();
}

Status Dispatcher::EndSpoiledJob(int job, const std::string& error) {
  if (job >= static_cast<int>(ledger_.jobs().size())) {  // what is lost is that it was accepted
    v1::Record record;
    record.mutable_job_accepted()->set_job(JobName(job));
    if (!ledger_.Check(record).ok()) return absl::OkStatus();  // no number that was ever given
    TESSERA_RETURN_IF_ERROR(CommitLocked(record));
  }
  if (HasEnded(ledger_.jobs()[job].header.state)) return absl::OkStatus();
  return EndJobLocked(job, JobState::kFailed, error + "; submit it again", {});
}

}  // namespace tessera
