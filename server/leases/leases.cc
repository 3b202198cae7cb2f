#include "server/leases/leases.h"

#include <algorithm>
#include <utility>

#include "common/base/json_bounds.h"
#include "server/leases/attempts.h"
#include "server/leases/known_results.h"
#include "server/ledger/check_record.h"
#include "server/ledger/digest_proto.h"
#include "server/ledger/task_inputs.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr int64_t kExpiryInterval_us = 100'000;   // between checks of leases
constexpr size_t kMaxStatisticsBytes = 64 << 10;  // a worker writes some hundred per round

// Limits the statistics, because job.json contains those of all tasks.
Status CheckStatistics(const std::string& stats) {
  if (stats.size() > kMaxStatisticsBytes) {
    return InputError("statistics", "", std::to_string(stats.size()) + " bytes",
                      "at most " + std::to_string(kMaxStatisticsBytes));
  }
  return CheckJsonDepth("statistics", stats);
}

// A message about an output that a reader needs and `outputs` lacks; empty if complete.
std::string MissingOutput(const Job& job, int task, const std::vector<NamedDigest>& outputs) {
  for (const int index : job.tasks[task].readers) {
    const JobTask& reader = job.tasks[index];
    for (const PlannedInput& input : reader.plan.inputs) {
      if (input.task.value() != task) continue;
      const bool found = std::any_of(outputs.begin(), outputs.end(),
                                     [&](const NamedDigest& output) { return output.name == input.output; });
      if (!found) return "no output " + input.output.str() + ", which '" + reader.plan.name + "' reads";
    }
  }
  return "";
}

}  // namespace

Leases::Leases(DispatchCore& core, LeaseEvents events)
    : core_(core), events_(std::move(events)), waiting_thread_([this] { ServeWaiting(); }) {}

Leases::~Leases() {
  core_.Stop();
  {
    std::lock_guard lock(mutex_);
    waiting_.End();
  }
  waiting_thread_.join();
}

StatusOr<std::string> Leases::RegisterWorker(const WorkerInfo& info) {
  std::lock_guard lock(mutex_);
  TESSERA_RETURN_IF_ERROR(CheckWorkerLimits(leases_, info.client, options_.worker_limits));
  // The start count of the store makes names unique across restarts.
  const std::string name =
      "workers/" + std::to_string(environment_.store->StartCount()) + "-" + std::to_string(next_worker_++);
  leases_.AddWorker(name, info, environment_.clock->MonotonicUs());
  core_.Changed();
  return name;
}

StatusOr<std::vector<std::string>> Leases::Heartbeat(const std::string& worker,
                                                     const std::vector<ReportedProgress>& tasks) {
  std::lock_guard lock(mutex_);
  TESSERA_RETURN_IF_ERROR(MarkSeen(core_, worker));
  std::vector<std::string> stop;
  for (const ReportedProgress& reported : tasks) {
    const auto ref = ledger_.FindTask(reported.task);
    LeaseState* lease = ref.ok() ? leases_.FindCurrent(*ref, worker, reported.attempt) : nullptr;
    if (lease == nullptr) {
      stop.push_back(reported.task);
      continue;
    }
    const int64_t now_us = environment_.clock->MonotonicUs();
    lease->expires_us = now_us + Micros(options_.lease_s);
    // NaN becomes 0.
    const double progress = reported.progress >= 0 ? std::min(1.0, reported.progress) : 0.0;
    if (progress != lease->progress || reported.stage != lease->stage) lease->progressed_us = now_us;
    lease->progress = progress;
    lease->stage = reported.stage;
  }
  if (!tasks.empty()) core_.Changed();
  return stop;
}

Status Leases::ExpireLocked() {
  const int64_t now_us = environment_.clock->MonotonicUs();
  const int64_t gap_us = last_expiry_us_ == 0 ? kExpiryInterval_us : now_us - last_expiry_us_;
  if (gap_us < kExpiryInterval_us) return absl::OkStatus();
  last_expiry_us_ = now_us;
  if (static_cast<double>(gap_us) * 1e-6 > options_.max_check_gap_s) {
    leases_.ShiftTimes(gap_us, now_us, Micros(options_.lease_s));
  }
  // Later than the last call of a worker whose lease expires now.
  const int64_t since_us = now_us - Micros(options_.lease_s / 2);
  const auto lives = [&](const std::string& machine) { return leases_.Lives(machine, since_us); };
  for (const TaskRef ref : leases_.Expired(now_us)) {
    const JobTask& task = ledger_.task(ref);
    const WorkerState* const worker = leases_.FindWorker(task.worker());
    const bool has_called = worker == nullptr || worker->has_called;
    TESSERA_RETURN_IF_ERROR(
        EndAttempt(core_, ref, DecideAfterExpiry(WithCountedAttempts(task), has_called, lives, options_.retry), true));
  }
  std::vector<std::pair<TaskRef, TaskFailure>> stalled;
  for (const auto& [ref, lease] : leases_.leases()) {
    const double limit_s = StallLimit_s(ledger_.task(ref).plan, lease.threads, options_.stall_s);
    if (now_us - lease.progressed_us <= Micros(limit_s)) continue;
    stalled.emplace_back(ref, StallOf(lease, limit_s));
  }
  for (const auto& [ref, failure] : stalled) TESSERA_RETURN_IF_ERROR(FailAttempt(core_, ref, failure));
  return absl::OkStatus();
}

Status Leases::Expire() {
  std::lock_guard lock(mutex_);
  TESSERA_RETURN_IF_ERROR(ExpireLocked());
  leases_.ForgetSilentWorkers(environment_.clock->MonotonicUs() - Micros(options_.forget_worker_s));
  return absl::OkStatus();
}

Status Leases::HandleSuccess(const std::string& worker, const std::string& task, int attempt,
                             const ReportedResult& result) {
  for (const NamedDigest& output : result.outputs) TESSERA_RETURN_IF_ERROR(CheckDigest(output.digest));
  {
    std::lock_guard lock(mutex_);
    MarkSeen(core_, worker).IgnoreError();  // the attempt number decides
    TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindReported(core_, task));
    const JobTask& target = ledger_.task(ref);
    if (target.state == TaskState::kSucceeded && !target.reused && target.attempt() == attempt &&
        target.worker() == worker) {
      return absl::OkStatus();  // repeated report: the first reply was lost
    }
    TESSERA_RETURN_IF_ERROR(CheckCurrent(core_, ref, worker, attempt));
    if (const Status status = CheckStatistics(result.stats); !status.ok()) {
      TESSERA_RETURN_IF_ERROR(FailAttempt(core_, ref, {ErrorClass::kInternal, std::string(status.message())}));
      return status;
    }
    v1::Record record;
    v1::TaskSucceeded& succeeded = *record.mutable_task_succeeded();
    succeeded.set_task(task);
    succeeded.set_attempt(attempt);
    succeeded.set_key(target.key_hex());
    succeeded.set_stats_json(result.stats);
    for (const std::string& warning : result.warnings) succeeded.add_warnings(warning);
    succeeded.mutable_usage()->set_core_seconds(result.usage.core_seconds);
    succeeded.mutable_usage()->set_peak_bytes(result.usage.peak_bytes);
    succeeded.mutable_usage()->set_threads(result.usage.threads);
    AddFiles(result.outputs, succeeded.mutable_outputs());
    TaskFailure failure;
    if (const std::string missing = MissingOutput(ledger_.jobs()[ref.job], ref.task, result.outputs);
        !missing.empty()) {
      failure = {ErrorClass::kInternal, missing};
    }
    if (const Status same = CheckSameAsBefore(ledger_.task(ref), result.outputs); !same.ok()) {
      failure = {ErrorClass::kInternal, std::string(same.message())};
    }
    if (failure.error_class != ErrorClass::kNone) {
      TESSERA_RETURN_IF_ERROR(FailAttempt(core_, ref, failure));
    } else {
      TESSERA_RETURN_IF_ERROR(core_.Commit(record));
      leases_.Release(ref);
      ReportSuspended(
          core_, NoteSuccess(ledger_.task(ref), worker, options_.retry, environment_.clock->MonotonicUs(), leases_));
    }
  }
  return absl::OkStatus();
}

Status Leases::HandleFailure(const std::string& worker, const std::string& task, int attempt,
                             const TaskFailure& failure) {
  if (failure.error_class == ErrorClass::kLostInput) return events_.lost_inputs(worker, task, attempt, failure);
  std::lock_guard lock(mutex_);
  MarkSeen(core_, worker).IgnoreError();
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindReported(core_, task));
  TESSERA_RETURN_IF_ERROR(CheckCurrent(core_, ref, worker, attempt));
  return FailAttempt(core_, ref, failure);
}

Status Leases::HandleUnregister(const std::string& worker) {
  std::lock_guard lock(mutex_);
  TESSERA_RETURN_IF_ERROR(MarkSeen(core_, worker));
  const std::set<TaskRef> held = leases_.FindWorker(worker)->tasks;
  for (const TaskRef ref : held) {
    TESSERA_RETURN_IF_ERROR(FailAttempt(core_, ref, {ErrorClass::kPreempted, worker + " unregistered"}));
  }
  leases_.RemoveWorker(worker);
  core_.Changed();
  if (waiting_.Wake(worker)) waiting_.Notify();  // its waiting call ends with an error
  return absl::OkStatus();
}

void Leases::ReportSuccess(const std::string& worker, const std::string& task, int attempt,
                           const ReportedResult& result, Done done) {
  Finish(HandleSuccess(worker, task, attempt, result), std::move(done));
}

void Leases::ReportFailure(const std::string& worker, const std::string& task, int attempt, const TaskFailure& failure,
                           Done done) {
  if (failure.error_class != ErrorClass::kLostInput) {
    return Finish(HandleFailure(worker, task, attempt, failure), std::move(done));
  }
  examine_thread_.Do(
      [=, this, done = std::move(done)] { Finish(HandleFailure(worker, task, attempt, failure), done); });
}

void Leases::UnregisterWorker(const std::string& worker, Done done) {
  Finish(HandleUnregister(worker), std::move(done));
}

void Leases::Finish(const Status& handled, Done done) {
  if (!handled.ok()) return done(handled);
  journal_.WhenStored(std::move(done));
  std::unique_lock lock(mutex_);
  const bool due = AdvanceIsDueLocked();
  lock.unlock();
  if (due) events_.advance_soon();
}

bool Leases::AdvanceIsDueLocked() {
  const std::vector<TaskRef>& ready = ledger_.newly_ready();
  if (!ledger_.due_jobs().empty()) return true;
  if (std::any_of(ready.begin(), ready.end(), [&](TaskRef ref) { return MayReuse(ledger_, ref); })) return true;
  ledger_.TakeNewlyReady();
  return false;
}

std::vector<WorkerStatus> Leases::ListWorkers() const {
  std::lock_guard lock(mutex_);
  std::vector<WorkerStatus> workers;
  const int64_t now_us = environment_.clock->MonotonicUs();
  for (const auto& [name, worker] : leases_.workers()) {
    WorkerStatus status{name, worker.info, {}, static_cast<double>(now_us - worker.last_seen_us) / 1e6};
    for (const TaskRef ref : worker.tasks) status.tasks.push_back(TaskName(ref));
    if (IsSuspended(worker, now_us)) {
      status.suspended_reason = worker.suspended_reason;
      status.suspended_s = static_cast<double>(worker.suspended_until_us - now_us) / 1e6;
    }
    if (worker.ends_us != 0) status.time_left_s = std::max(0.0, TimeLeft_s(worker, now_us));
    workers.push_back(std::move(status));
  }
  return workers;
}

std::vector<std::pair<std::string, int>> Leases::LeasesOf(const std::string& worker) const {
  std::lock_guard lock(mutex_);
  std::vector<std::pair<std::string, int>> leases;
  const auto known = leases_.workers().find(worker);
  if (known == leases_.workers().end()) return leases;
  for (const TaskRef ref : known->second.tasks) {
    const LeaseState* const lease = leases_.Find(ref);
    if (lease != nullptr) leases.emplace_back(TaskName(ref), lease->attempt);
  }
  return leases;
}

std::set<std::string> Leases::InputsOfLeases(const std::string& worker) const {
  std::lock_guard lock(mutex_);
  std::set<std::string> inputs;
  const auto known = leases_.workers().find(worker);
  if (known == leases_.workers().end()) return inputs;
  for (const TaskRef ref : known->second.tasks) {
    const auto read = InputsOf(ledger_.jobs()[ref.job], ledger_.task(ref).plan);
    if (!read.ok()) continue;  // an input is being recomputed
    for (const NamedDigest& input : *read) inputs.insert(input.digest.sha256);
  }
  return inputs;
}

}  // namespace tessera
