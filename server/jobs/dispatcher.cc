#include "server/jobs/dispatcher.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "common/base/json_bounds.h"
#include "common/base/printable.h"
#include "common/base/refusal.h"
#include "common/base/version.h"
#include "server/jobs/waiting_for.h"
#include "server/ledger/digest_proto.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr int64_t kExpiryInterval_us = 100'000;  // between two looks for leases that are over

constexpr size_t kMaxStatisticsBytes = 64 << 10;  // ours have some hundred a round

// Every task's go into job.json.
Status CheckStatistics(const std::string& stats) {
  if (stats.size() > kMaxStatisticsBytes) {
    return InputError("statistics", "", std::to_string(stats.size()) + " bytes",
                      "at most " + std::to_string(kMaxStatisticsBytes));
  }
  return CheckJsonDepth("statistics", stats);
}

// An output that some later task reads but `outputs` lacks, as a message; empty if all are there.
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

std::function<void(const std::string&)> ObserveWith(
    const std::function<void(const v1::Record&, const ChangedTask&)>& on_change, ChangedTasks& tasks) {
  if (!on_change) return {};
  return [on_change, &tasks](const std::string& bytes) {
    const ChangedTask task = tasks.Pop();
    v1::Record record;
    if (record.ParseFromString(bytes)) on_change(record, task);
  };
}

}  // namespace

Dispatcher::Dispatcher(const DispatchEnvironment& environment, const DispatchOptions& options)
    : environment_(environment),
      options_(options),
      ledger_(kAlgorithmVersion),
      journal_(environment.store,
               {options.durable_wait_s, ObserveWith(environment.on_change, changed_tasks_), environment.on_trouble}),
      waiting_thread_([this] { ServeWaiting(); }) {}

Dispatcher::~Dispatcher() {
  Stop();
  {
    std::lock_guard lock(mutex_);
    ends_ = true;
  }
  waiting_changed_.notify_one();
  waiting_thread_.join();
}

void Dispatcher::ChangedLocked() {
  ++version_;
  changed_.notify_all();
}

Status Dispatcher::CommitLocked(v1::Record& record, Durability durability) {
  if (record.time_us() == 0) record.set_time_us(environment_.clock->UnixTimeUs());
  TESSERA_RETURN_IF_ERROR(ledger_.Check(record));
  const int ready_before = ledger_.ready().count();
  const size_t newly_ready_before = ledger_.newly_ready().size();
  ledger_.Apply(record);
  NoteReferencesLocked(record);
  const std::optional<TaskRef> ref = TaskOf(record, ledger_);
  counts_.Count(record, ledger_, ref);
  if (environment_.on_change) {
    const JobTask* const task = ref ? &ledger_.task(*ref) : nullptr;
    changed_tasks_.Push(task ? ChangedTask{task->plan.kind, task->plan.tile, task->worker()} : ChangedTask());
  }
  journal_.Add(record.SerializeAsString(), durability);
  ChangedLocked();
  WakeForLocked(ledger_.ready().count() - ready_before, newly_ready_before);
  return absl::OkStatus();
}

void Dispatcher::WakeForLocked(int more, size_t first) {
  if (more <= 0) return;
  waiting_.ReadyHasGrown();
  for (size_t i = first; i < ledger_.newly_ready().size(); ++i) {
    const TaskRef ref = ledger_.newly_ready()[i];
    const std::string& keeper = leases_.KeeperOf({ref.job, ledger_.task(ref).plan.tile});
    waiting_.Wake(keeper);
    more -= keeper.empty() ? 0 : 1;  // it comes for it, or others that look again see it
  }
  while (more-- > 0 && waiting_.WakeNext()) {
  }
  ServeWokenLocked();
}

// --- Jobs ---

JobStatus Dispatcher::JobStatusLocked(int job) const {
  const int64_t now_us = environment_.clock->MonotonicUs();
  JobStatus status = StatusOfJob(ledger_.jobs()[job], job, leases_, now_us);
  status.waiting_for = WaitingFor(ledger_, job, leases_, journal_.trouble(), room_, now_us);
  // What an attempt had done is lost with it, but the bar does not go back.
  if (shown_progress_.size() < ledger_.jobs().size()) shown_progress_.resize(ledger_.jobs().size());
  status.progress = shown_progress_[job] = std::max(status.progress, shown_progress_[job]);
  return status;
}

Status Dispatcher::MayCreateJobLocked(const std::string& client) const {
  if (draining_) return DrainingError("accepts no jobs");
  return CheckJobLimits(ledger_, client, options_.limits);
}

Status Dispatcher::MayCreateJob(const std::string& client) const {
  std::lock_guard lock(mutex_);
  return MayCreateJobLocked(client);
}

StatusOr<JobStatus> Dispatcher::CreateJob(const NewJob& asked) {
  TESSERA_ASSIGN_OR_RETURN(const NewJob job, CompleteJob(asked));
  v1::Record record;
  v1::JobAccepted& accepted = *record.mutable_job_accepted();
  if (!job.request.id.empty()) {
    accepted.set_request_id(job.request.id);
    accepted.mutable_request()->set_scene_path(job.request.scene_path);
    ToProto(job.request.settings, accepted.mutable_request()->mutable_settings());
  }
  accepted.set_display_name(job.display_name);
  accepted.set_scene_path(job.scene_path);
  ToProto(job.settings, accepted.mutable_settings());
  for (const NamedDigest& file : job.scene_files) {
    v1::SceneFileRecord& added = *accepted.add_scene_files();
    added.set_path(file.name);
    ToProto(file.digest, added.mutable_digest());
  }
  for (const std::string& warning : job.warnings) accepted.add_warnings(AsUtf8(warning));
  accepted.set_algorithm_version(kAlgorithmVersion);
  accepted.set_priority(job.priority);
  accepted.set_client(job.client);
  std::optional<JobStatus> known;
  int index = -1;
  {
    const std::shared_lock refers(blobs_mutex_);
    if (!job.classifier.empty()) TESSERA_RETURN_IF_ERROR(environment_.blobs->PutBytes(job.classifier).status());
    std::lock_guard lock(mutex_);
    TESSERA_ASSIGN_OR_RETURN(known, FindRequestLocked(job.request));
    if (!known) {
      TESSERA_RETURN_IF_ERROR(MayCreateJobLocked(job.client));
      // They may have been deleted since the job was completed.
      for (const std::string& name : {job.settings.update.base, job.settings.update.rollback_to}) {
        if (!name.empty()) TESSERA_RETURN_IF_ERROR(ledger_.FindJob(name).status());
      }
      index = static_cast<int>(ledger_.jobs().size());
      accepted.set_job(JobName(index));
      TESSERA_RETURN_IF_ERROR(CommitLocked(record));
    }
  }
  TESSERA_RETURN_IF_ERROR(Durable());
  if (known) return *std::move(known);
  // The job is accepted whatever comes of this; Tick tries again and tells.
  Advance().IgnoreError();
  std::lock_guard lock(mutex_);
  return JobStatusLocked(index);
}

StatusOr<std::optional<JobStatus>> Dispatcher::FindRequest(const JobRequest& request) const {
  std::optional<JobStatus> known;
  {
    std::lock_guard lock(mutex_);
    TESSERA_ASSIGN_OR_RETURN(known, FindRequestLocked(request));
  }
  if (known) TESSERA_RETURN_IF_ERROR(Durable());  // the call that made it may still wait for that
  return known;
}

StatusOr<std::optional<JobStatus>> Dispatcher::FindRequestLocked(const JobRequest& request) const {
  TESSERA_ASSIGN_OR_RETURN(const int index, ledger_.FindRequest(request));
  if (index < 0) return std::nullopt;
  return JobStatusLocked(index);
}

StatusOr<JobStatus> Dispatcher::GetJob(const std::string& name) const {
  JobStatus status;
  {
    std::lock_guard lock(mutex_);
    TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
    status = JobStatusLocked(job);
  }
  if (HasEnded(status.header.state)) TESSERA_RETURN_IF_ERROR(Durable());  // no end is told that might not last
  return status;
}

StatusOr<JobStatus> Dispatcher::CancelJob(const std::string& name) {
  {
    std::lock_guard lock(mutex_);
    TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
    if (!HasEnded(ledger_.jobs()[job].header.state)) {
      TESSERA_RETURN_IF_ERROR(EndJobLocked(job, JobState::kCancelled, "cancelled", {}));
    }
  }
  return GetJob(name);
}

std::vector<std::string> Dispatcher::SceneFilesWith(const Digest& digest) const {
  std::lock_guard lock(mutex_);
  return ledger_.SceneFilesWith(digest);
}

// --- Workers ---

StatusOr<std::string> Dispatcher::RegisterWorker(const WorkerInfo& info) {
  std::lock_guard lock(mutex_);
  TESSERA_RETURN_IF_ERROR(CheckWorkerLimits(leases_, info.client, options_.worker_limits));
  // The store's start count keeps a worker of before a restart from sharing its name with a new one.
  const std::string name =
      "workers/" + std::to_string(environment_.store->StartCount()) + "-" + std::to_string(next_worker_++);
  leases_.AddWorker(name, info, environment_.clock->MonotonicUs());
  ChangedLocked();
  return name;
}

Status Dispatcher::SeenLocked(const std::string& worker) {
  WorkerState* const known = leases_.FindWorker(worker);
  if (known == nullptr) {
    return Refuse(Refusal::kUnknownWorker,
                  absl::NotFoundError("no such worker: '" + worker + "'; it has to register again"));
  }
  known->last_seen_us = environment_.clock->MonotonicUs();
  known->heard = true;
  return absl::OkStatus();
}

StatusOr<std::vector<std::string>> Dispatcher::Heartbeat(const std::string& worker,
                                                         const std::vector<ReportedProgress>& tasks) {
  std::lock_guard lock(mutex_);
  TESSERA_RETURN_IF_ERROR(SeenLocked(worker));
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
    // NaN and the like become 0.
    const double progress = reported.progress >= 0 ? std::min(1.0, reported.progress) : 0.0;
    if (progress != lease->progress || reported.stage != lease->stage) lease->moved_us = now_us;
    lease->progress = progress;
    lease->stage = reported.stage;
  }
  if (!tasks.empty()) ChangedLocked();
  return stop;
}

Status Dispatcher::FailAttemptLocked(TaskRef ref, const TaskFailure& failure) {
  const int64_t now_us = environment_.clock->MonotonicUs();
  const JobTask& task = ledger_.task(ref);
  const JobTask counted = WithCountedAttempts(task);
  const Witnesses witnesses = WitnessesOf(counted, leases_, options_.retry, now_us);
  TESSERA_RETURN_IF_ERROR(EndAttemptLocked(ref, JudgeFailure(counted, failure, options_.retry, witnesses), false));
  TellSetAsideLocked(NoteFailure(task, failure, options_.retry, now_us, leases_));
  return absl::OkStatus();
}

Status Dispatcher::EndAttemptLocked(TaskRef ref, const RetryVerdict& verdict, bool lease_expired) {
  v1::Record record;
  v1::AttemptFailed& failed = *record.mutable_attempt_failed();
  failed.set_task(TaskName(ref));
  failed.set_attempt(ledger_.task(ref).attempt());
  failed.mutable_error()->set_error_class(static_cast<v1::ErrorClass>(verdict.failure.error_class));
  failed.mutable_error()->set_message(verdict.failure.message);
  failed.set_final(verdict.final);
  failed.set_lease_expired(lease_expired);
  failed.set_retry_delay_us(Micros(verdict.delay_s));
  TESSERA_RETURN_IF_ERROR(CommitLocked(record));
  ledger_.PromoteRetries(environment_.clock->MonotonicUs());  // the delay begins
  leases_.Release(ref);
  return absl::OkStatus();
}

Status Dispatcher::ExpireLeasesLocked() {
  const int64_t now_us = environment_.clock->MonotonicUs();
  const int64_t gap_us = last_expiry_us_ == 0 ? kExpiryInterval_us : now_us - last_expiry_us_;
  if (gap_us < kExpiryInterval_us) return absl::OkStatus();
  last_expiry_us_ = now_us;
  if (static_cast<double>(gap_us) * 1e-6 > options_.stood_still_s) {
    leases_.LeaveOut(gap_us, now_us, Micros(options_.lease_s));
  }
  // Later than anything that was heard from a worker whose lease expires now.
  const int64_t since_us = now_us - Micros(options_.lease_s / 2);
  const auto lives = [&](const std::string& machine) { return leases_.Lives(machine, since_us); };
  for (const TaskRef ref : leases_.Expired(now_us)) {
    const JobTask& task = ledger_.task(ref);
    const WorkerState* const worker = leases_.FindWorker(task.worker());
    const bool heard = worker == nullptr || worker->heard;
    TESSERA_RETURN_IF_ERROR(
        EndAttemptLocked(ref, JudgeSilence(WithCountedAttempts(task), heard, lives, options_.retry), true));
  }
  std::vector<std::pair<TaskRef, TaskFailure>> stalled;
  for (const auto& [ref, lease] : leases_.leases()) {
    const double limit_s = StallLimit_s(ledger_.task(ref).plan, lease.threads, options_.stall_s);
    if (now_us - lease.moved_us <= Micros(limit_s)) continue;
    stalled.emplace_back(ref, StallOf(lease, limit_s));
  }
  for (const auto& [ref, failure] : stalled) TESSERA_RETURN_IF_ERROR(FailAttemptLocked(ref, failure));
  return absl::OkStatus();
}

StatusOr<TaskRef> Dispatcher::FindReportedLocked(const std::string& task) const {
  StatusOr<TaskRef> ref = ledger_.FindTask(task);
  if (!ref.ok()) return Refuse(Refusal::kNotCurrent, ref.status());
  return ref;
}

Status Dispatcher::CheckCurrentLocked(TaskRef ref, const std::string& worker, int attempt) {
  if (leases_.FindCurrent(ref, worker, attempt) != nullptr) return absl::OkStatus();
  return Refuse(Refusal::kNotCurrent,
                absl::FailedPreconditionError(TaskName(ref) + ": attempt " + std::to_string(attempt) + " of " + worker +
                                              " is not the current one"));
}

Status Dispatcher::TakeSuccess(const std::string& worker, const std::string& task, int attempt,
                               const ReportedResult& result) {
  const std::shared_lock refers(blobs_mutex_);
  TaskFailure not_stored;
  for (const NamedDigest& output : result.outputs) {
    TESSERA_RETURN_IF_ERROR(CheckDigest(output.digest));
    if (environment_.blobs->Has(output.digest)) continue;
    not_stored = {ErrorClass::kInternal, "output " + output.name + " was reported but is not stored"};
  }
  {
    std::lock_guard lock(mutex_);
    SeenLocked(worker).IgnoreError();  // the attempt number is what counts
    TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindReportedLocked(task));
    const JobTask& target = ledger_.task(ref);
    if (target.state == TaskState::kSucceeded && !target.reused && target.attempt() == attempt &&
        target.worker() == worker) {
      return absl::OkStatus();  // said twice: the first answer was lost
    }
    TESSERA_RETURN_IF_ERROR(CheckCurrentLocked(ref, worker, attempt));
    if (const Status status = CheckStatistics(result.stats); !status.ok()) {
      TESSERA_RETURN_IF_ERROR(FailAttemptLocked(ref, {ErrorClass::kInternal, std::string(status.message())}));
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
    TaskFailure failure = not_stored;
    if (const std::string missing = MissingOutput(ledger_.jobs()[ref.job], ref.task, result.outputs);
        !missing.empty()) {
      failure = {ErrorClass::kInternal, missing};
    }
    if (const Status same = ledger_.CheckSameAsBefore(ref, result.outputs); !same.ok()) {
      failure = {ErrorClass::kInternal, std::string(same.message())};
    }
    if (failure.error_class != ErrorClass::kNone) {
      TESSERA_RETURN_IF_ERROR(FailAttemptLocked(ref, failure));
    } else {
      TESSERA_RETURN_IF_ERROR(CommitLocked(record));
      leases_.Release(ref);
      TellSetAsideLocked(
          NoteSuccess(ledger_.task(ref), worker, options_.retry, environment_.clock->MonotonicUs(), leases_));
    }
  }
  return absl::OkStatus();
}

Status Dispatcher::TakeFailure(const std::string& worker, const std::string& task, int attempt,
                               const TaskFailure& failure) {
  if (failure.error_class == ErrorClass::kLostInput) return ReportLostInputs(worker, task, attempt, failure);
  std::lock_guard lock(mutex_);
  SeenLocked(worker).IgnoreError();
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindReportedLocked(task));
  TESSERA_RETURN_IF_ERROR(CheckCurrentLocked(ref, worker, attempt));
  return FailAttemptLocked(ref, failure);
}

Status Dispatcher::TakeLeave(const std::string& worker) {
  std::lock_guard lock(mutex_);
  TESSERA_RETURN_IF_ERROR(SeenLocked(worker));
  const std::set<TaskRef> held = leases_.FindWorker(worker)->tasks;
  for (const TaskRef ref : held) {
    TESSERA_RETURN_IF_ERROR(FailAttemptLocked(ref, {ErrorClass::kPreempted, worker + " has left"}));
  }
  leases_.RemoveWorker(worker);
  ChangedLocked();
  if (waiting_.Wake(worker)) ServeWokenLocked();  // to be told that it is unknown
  return absl::OkStatus();
}

std::vector<WorkerStatus> Dispatcher::ListWorkers() const {
  std::lock_guard lock(mutex_);
  std::vector<WorkerStatus> workers;
  const int64_t now_us = environment_.clock->MonotonicUs();
  for (const auto& [name, worker] : leases_.workers()) {
    WorkerStatus status{name, worker.info, {}, static_cast<double>(now_us - worker.last_seen_us) / 1e6};
    for (const TaskRef ref : worker.tasks) status.tasks.push_back(TaskName(ref));
    if (IsSetAside(worker, now_us)) {
      status.set_aside_reason = worker.set_aside_reason;
      status.set_aside_s = static_cast<double>(worker.set_aside_until_us - now_us) / 1e6;
    }
    workers.push_back(std::move(status));
  }
  return workers;
}

// --- Waiting ---

int64_t Dispatcher::Version() const {
  std::lock_guard lock(mutex_);
  return version_;
}

int64_t Dispatcher::WaitForChange(int64_t seen, double seconds) const {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, std::chrono::microseconds(Micros(seconds)), [&] { return stopped_ || version_ > seen; });
  return version_;
}

void Dispatcher::Drain() {
  std::lock_guard lock(mutex_);
  draining_ = true;
  waiting_.WakeAll();
  ServeWokenLocked();
}

void Dispatcher::Stop() {
  std::lock_guard lock(mutex_);
  stopped_ = true;
  ChangedLocked();
  waiting_.WakeAll();
  ServeWokenLocked();
}

bool Dispatcher::stopped() const {
  std::lock_guard lock(mutex_);
  return stopped_;
}

}  // namespace tessera
