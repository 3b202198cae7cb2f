#include "server/ledger/ledger.h"

#include <algorithm>
#include <set>
#include <utility>

#include "common/job/task_parameters.h"
#include "server/ledger/digest_proto.h"
#include "server/ledger/task_key.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr int64_t kMaxRetryDelayUs = int64_t{86'400'000'000} * 365;

}  // namespace

StatusOr<int> Ledger::FindJob(const std::string& name) const {
  TESSERA_ASSIGN_OR_RETURN(const int job, ParseJobName(name));
  if (job >= static_cast<int>(jobs_.size())) return absl::NotFoundError("no such job: " + name);
  if (WasDeleted(job)) return absl::NotFoundError(name + " was deleted");
  return job;
}

StatusOr<TaskRef> Ledger::FindTask(const std::string& name) const {
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, ParseTaskName(name));
  if (ref.job >= static_cast<int>(jobs_.size()) || WasDeleted(ref.job) ||
      ref.task >= static_cast<int>(jobs_[ref.job].tasks.size())) {
    return absl::NotFoundError("no such task: " + name);
  }
  return ref;
}

StatusOr<int> Ledger::FindRequest(const JobRequest& request) const {
  const auto it = job_of_request_.find(request.id);
  if (it == job_of_request_.end()) return -1;
  const JobHeader& header = jobs_[it->second].header;
  if (!header.request) return it->second;
  std::vector<std::string> differences = Differences(request.settings, header.request->settings);
  if (request.scene_path != header.request->scene_path) {
    differences.push_back("scene_path: found " + request.scene_path + ", expected " + header.request->scene_path);
  }
  if (differences.empty()) return it->second;
  std::string message = "request " + request.id + " was used for " + header.name + " with other values:";
  for (const std::string& difference : differences) message += "\n" + difference;
  return absl::AlreadyExistsError(message);
}

StatusOr<Digest> Ledger::InputDigest(const Job& job, const PlannedInput& input) const {
  const JobTask& producer = job.tasks[input.task.value()];
  for (const StoredFile& output : producer.outputs) {
    if (output.name == input.output) return output.digest();
  }
  return absl::NotFoundError("no output " + input.output.str() + " of '" + producer.plan.name + "' yet");
}

StatusOr<std::vector<NamedDigest>> Ledger::InputsOf(const Job& job, const PlannedTask& task) const {
  std::vector<NamedDigest> inputs;
  inputs.reserve(task.inputs.size() + task.scene_files->size() + task.view_files->size());
  for (const PlannedInput& input : task.inputs) {
    TESSERA_ASSIGN_OR_RETURN(const Digest digest, InputDigest(job, input));
    inputs.push_back({InputName(input), digest});
  }
  for (const int file : *task.scene_files) {
    const NamedDigest& found = job.scene_files[file];
    inputs.push_back({std::string(kSceneFolder) + "/" + found.name, found.digest});
  }
  for (const PlannedTask::ViewFile& file : *task.view_files) {
    inputs.push_back({ViewFileName(file.view, file.likelihoods), job.scene_files[file.file].digest});
  }
  return inputs;
}

const absl::InlinedVector<StoredFile, 1>* Ledger::FindResult(const Sha256& key) const {
  const auto it = tasks_of_key_.find(key);
  for (TaskRef ref = it == tasks_of_key_.end() ? TaskRef() : *it; ref.job >= 0; ref = task(ref).older_with_key) {
    if (!WasDeleted(ref.job)) return &task(ref).outputs;
  }
  return nullptr;
}

void Ledger::RememberTask(TaskRef ref) {
  TaskRef& older = jobs_[ref.job].tasks[ref.task].older_with_key;
  older = {};
  if (const auto last = tasks_of_key_.find(ref); last != tasks_of_key_.end()) {
    older = *last;
    tasks_of_key_.erase(last);
  }
  tasks_of_key_.insert(ref);
}

void Ledger::ForgetTask(TaskRef ref) {
  const JobTask& forgotten = task(ref);
  const auto last = forgotten.key ? tasks_of_key_.find(ref) : tasks_of_key_.end();
  if (last == tasks_of_key_.end()) return;
  if (*last == ref) {
    tasks_of_key_.erase(last);
    if (forgotten.older_with_key.job >= 0) tasks_of_key_.insert(forgotten.older_with_key);
    return;
  }
  for (TaskRef newer = *last; newer.job >= 0; newer = task(newer).older_with_key) {
    TaskRef& older = jobs_[newer.job].tasks[newer.task].older_with_key;
    if (older != ref) continue;
    older = forgotten.older_with_key;
    return;
  }
}

StatusOr<TaskRef> Ledger::CheckCurrentAttempt(const std::string& name, int attempt) const {
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindTask(name));
  const JobTask& target = task(ref);
  if (!MayRun(ref)) {
    return absl::FailedPreconditionError(name + ": its job has ended");
  }
  if (target.state != TaskState::kLeased || target.attempt() != attempt) {
    return absl::FailedPreconditionError(name + ": attempt " + std::to_string(attempt) + " is not the current one (" +
                                         std::to_string(target.attempt()) +
                                         (target.state == TaskState::kLeased ? ")" : ", not leased)"));
  }
  return ref;
}

int Ledger::ActiveJobsOf(const std::string& client) const {
  const auto found = active_of_client_.find(client);
  return found == active_of_client_.end() ? 0 : found->second;
}

void Ledger::CountActive(const std::string& client, int more) {
  const auto counted = active_of_client_.try_emplace(client, 0).first;
  counted->second += more;
  if (counted->second == 0) active_of_client_.erase(counted);
}

Status Ledger::CheckAccepted(const v1::JobAccepted& change) const {
  TESSERA_ASSIGN_OR_RETURN(const int index, ParseJobName(change.job()));
  if (!MayBeNext(index)) {
    const int next = static_cast<int>(jobs_.size());
    return absl::FailedPreconditionError("the next job is " + JobName(next) + ", not " + change.job());
  }
  if (job_of_request_.contains(change.request_id())) {
    return absl::AlreadyExistsError("request " + change.request_id() + " already has a job");
  }
  TESSERA_RETURN_IF_ERROR(CheckPriority(change.priority()));
  std::set<std::string> names;
  for (const auto& file : change.scene_files()) {
    TESSERA_RETURN_IF_ERROR(CheckDigest(FromProto(file.digest())));
    if (!names.insert(file.path()).second) return absl::InvalidArgumentError("duplicate scene file: " + file.path());
  }
  return absl::OkStatus();
}

Status Ledger::CheckStarted(const v1::AttemptStarted& change) const {
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindTask(change.task()));
  const JobTask& target = task(ref);
  if (!MayRun(ref) || target.state != TaskState::kReady) {
    return absl::FailedPreconditionError(change.task() + " is not ready");
  }
  if (change.attempt() != target.attempt() + 1) {
    return absl::FailedPreconditionError(change.task() + ": the next attempt is " +
                                         std::to_string(target.attempt() + 1));
  }
  return absl::OkStatus();
}

Status Ledger::CheckSucceeded(const v1::TaskSucceeded& change) const {
  std::set<std::string> names;
  for (const auto& output : change.outputs()) {
    TESSERA_RETURN_IF_ERROR(CheckDigest(FromProto(output.digest())));
    if (!names.insert(output.name()).second) return absl::InvalidArgumentError("duplicate output: " + output.name());
  }
  if (!Sha256::FromHex(change.key())) return absl::InvalidArgumentError("malformed key: '" + change.key() + "'");
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindTask(change.task()));
  TESSERA_RETURN_IF_ERROR(CheckSameAsBefore(ref, NamedDigests(change.outputs())));
  if (!change.reused()) return CheckCurrentAttempt(change.task(), change.attempt()).status();
  if (!MayRun(ref) || task(ref).state != TaskState::kReady) {
    return absl::FailedPreconditionError(change.task() + " is not ready");
  }
  return absl::OkStatus();
}

Status Ledger::CheckFailed(const v1::AttemptFailed& change) const {
  return CheckCurrentAttempt(change.task(), change.attempt()).status();
}

Status Ledger::CheckEnded(const v1::JobEnded& change) const {
  TESSERA_ASSIGN_OR_RETURN(const int index, FindJob(change.job()));
  const Job& job = jobs_[index];
  if (HasEnded(job.header.state)) return absl::FailedPreconditionError(change.job() + " has ended");
  if (!HasEnded(static_cast<JobState>(change.state()))) return absl::InvalidArgumentError("not a final state of a job");
  if (change.state() == v1::JOB_STATE_SUCCEEDED || change.state() == v1::JOB_STATE_PARTIAL) {
    if (job.quarantined.empty() != (change.state() == v1::JOB_STATE_SUCCEEDED)) {
      return absl::FailedPreconditionError(change.job() + ": " + std::to_string(job.quarantined.size()) +
                                           " tiles are quarantined");
    }
    for (const JobTask& each : job.tasks) {
      if (!each.superseded && each.state != TaskState::kSucceeded) {
        return absl::FailedPreconditionError(change.job() + ": '" + each.plan.name + "' has not succeeded");
      }
    }
  }
  return absl::OkStatus();
}

void Ledger::ApplyAccepted(const v1::JobAccepted& change, int64_t time_us) {
  Job job;
  job.header.name = change.job();
  if (change.has_request()) {
    job.header.request = {change.request_id(), change.request().scene_path(), FromProto(change.request().settings())};
  }
  job.header.display_name = change.display_name();
  job.header.scene_path = change.scene_path();
  job.header.settings = FromProto(change.settings());
  job.header.algorithm_version = change.algorithm_version();
  job.header.create_us = time_us;
  job.header.priority = change.priority();
  job.header.client = change.client();
  job.header.warnings.assign(change.warnings().begin(), change.warnings().end());
  for (const auto& file : change.scene_files()) {
    job.scene_files.push_back({file.path(), FromProto(file.digest())});
    if (!LiesInScene(file.path())) continue;
    std::vector<ScenePath>& paths = scene_files_of_sha256_[file.digest().sha256()];
    const std::string path = change.scene_path() + "/" + file.path();
    const auto known = std::find_if(paths.begin(), paths.end(), [&](const auto& each) { return each.path == path; });
    ++(known != paths.end() ? *known : paths.emplace_back(ScenePath{path})).jobs;
  }
  std::sort(job.scene_files.begin(), job.scene_files.end(),
            [](const NamedDigest& a, const NamedDigest& b) { return a.name < b.name; });
  const int index = *ParseJobName(change.job());
  FillJobsUpTo(index);
  if (!change.request_id().empty()) job_of_request_[change.request_id()] = index;
  jobs_.push_back(std::move(job));
  active_jobs_.push_back(index);
  CountActive(change.client(), 1);
  ready_.SetJob(index, change.priority(), /*paused=*/false);
  UpdateDue(index);
}

void Ledger::UpdateDue(int index) {
  const Job& job = jobs_[index];
  // open_plan: the coordinator stopped between the records of a plan.
  const bool asks =
      job.tasks.empty() || job.unfinished == 0 || job.open_plan >= 0 || (job.plans_anew && CutsAreDone(job));
  const bool due = (asks && job.lost == 0) || job.failed >= 0 || !job.lost_error.empty();
  if (due && !HasEnded(job.header.state)) {
    due_jobs_.insert(index);
  } else {
    due_jobs_.erase(index);
  }
}

void Ledger::ReadyTask(TaskRef ref) {
  const Job& job = jobs_[ref.job];
  JobTask& waiting = jobs_[ref.job].tasks[ref.task];
  if (waiting.state != TaskState::kWaiting || waiting.missing > 0 || !waiting.plan.given->empty()) return;
  if (job.open_plan >= 0 && ref.task >= job.open_plan) return;
  StatusOr<std::vector<NamedDigest>> inputs = InputsOf(job, waiting.plan);
  if (!inputs.ok()) return;
  inputs->resize(inputs->size() - waiting.plan.view_files->size());  // other inputs determine the view files
  waiting.state = TaskState::kReady;
  waiting.key = Sha256::FromHex(TaskKey(algorithm_version_, waiting.plan.kind, waiting.plan.parameters, *inputs));
  newly_ready_.push_back(ref);
  if (job.failed < 0) ready_.Add(ref, waiting);
}

std::vector<TaskRef> Ledger::TakeNewlyReady() { return std::exchange(newly_ready_, {}); }

void Ledger::ApplyStarted(const v1::AttemptStarted& change, int64_t time_us) {
  const TaskRef ref = *FindTask(change.task());
  JobHeader& header = jobs_[ref.job].header;
  JobTask& target = jobs_[ref.job].tasks[ref.task];
  ready_.Remove(ref, target);
  target.state = TaskState::kLeased;
  target.attempts.push_back({change.worker(), change.machine(), time_us, 0, {}, false});
  target.attempts.back().after_end = HasEnded(header.state);
  if (target.start_us == 0) target.start_us = time_us;
  if (header.state == JobState::kQueued) {
    header.state = JobState::kRunning;
    header.start_us = time_us;
  }
}

void Ledger::ApplySucceeded(const v1::TaskSucceeded& change, int64_t time_us) {
  const TaskRef ref = *FindTask(change.task());
  Job& job = jobs_[ref.job];
  JobTask& target = job.tasks[ref.task];
  if (target.state == TaskState::kReady) ready_.Remove(ref, target);  // reused
  ForgetTask(ref);
  target.state = TaskState::kSucceeded;
  --job.unfinished;
  if (!change.reused()) target.attempts.back().end_us = time_us;
  if (!HasEnded(job.header.state)) {  // an ended job keeps its numbers
    target.key = Sha256::FromHex(change.key());
    target.reused = change.reused();
    const std::vector<NamedDigest> outputs = NamedDigests(change.outputs());
    target.outputs.assign(outputs.begin(), outputs.end());
    target.stats = change.stats_json();
    target.usage = {change.usage().core_seconds(), change.usage().peak_bytes(), change.usage().threads()};
    target.warnings = Warnings(change.warnings().begin(), change.warnings().end());
    target.end_us = time_us;
    if (change.reused()) target.start_us = time_us;
    if (!target.superseded) job.totals.AddSucceeded(ref.task, target);
  }
  if (job.header.state == JobState::kQueued) {
    job.header.state = JobState::kRunning;
    job.header.start_us = time_us;
  }
  RememberTask(ref);
  for (const int reader : target.readers) {
    --job.tasks[reader].missing;
    ReadyTask({ref.job, reader});
  }
  if (target.remaking) EndRemake(ref);
  UpdateDue(ref.job);
}

void Ledger::ApplyFailed(const v1::AttemptFailed& change, int64_t time_us) {
  const TaskRef ref = *FindTask(change.task());
  Job& job = jobs_[ref.job];
  JobTask& target = job.tasks[ref.task];
  Attempt& attempt = target.attempts.back();
  attempt.end_us = time_us;
  attempt.failure = TaskFailure{static_cast<ErrorClass>(change.error().error_class()), change.error().message()};
  attempt.lease_expired = change.lease_expired();
  target.error = attempt.failure;
  target.retry_delay_us = change.retry_delay_us();
  if (change.retry_time_us() > time_us) target.retry_delay_us = change.retry_time_us() - time_us;
  target.retry_delay_us = std::clamp(target.retry_delay_us, int64_t{0}, kMaxRetryDelayUs);
  target.state = change.final() ? TaskState::kFailed : target.missing > 0 ? TaskState::kWaiting : TaskState::kReady;
  if (change.final() && HasEnded(job.header.state)) {
    GiveUpRemake(ref, target.error);
  } else if (change.final()) {
    target.end_us = time_us;
    job.failed = job.failed < 0 ? ref.task : std::min(job.failed, ref.task);
    ready_.DropJob(ref.job);  // the planning loop ends the job
    UpdateDue(ref.job);
  } else if (job.failed < 0 && target.state == TaskState::kReady) {
    ready_.Add(ref, target);
  }
}

void Ledger::ApplyEnded(const v1::JobEnded& change, int64_t time_us) {
  const int index = *FindJob(change.job());
  Job& job = jobs_[index];
  job.header.state = static_cast<JobState>(change.state());
  job.header.error = change.error();
  job.header.end_us = time_us;
  job.header.artifacts = NamedDigests(change.artifacts());
  for (JobTask& each : job.tasks) {
    if (each.superseded || each.state == TaskState::kSucceeded || each.state == TaskState::kFailed) continue;
    if (each.state == TaskState::kLeased) {
      each.attempts.back().end_us = time_us;
      each.attempts.back().cancelled = true;
    }
    each.state = TaskState::kCancelled;
    each.end_us = time_us;
  }
  active_jobs_.erase(std::find(active_jobs_.begin(), active_jobs_.end(), index));
  CountActive(job.header.client, -1);
  ready_.DropJob(index);
  UpdateDue(index);
}

}  // namespace tessera
