#include "server/dispatch/ledger.h"

#include <algorithm>
#include <set>
#include <utility>

#include "common/tile/task_parameters.h"
#include "server/dispatch/task_key.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

// Jobs in a row of which it may be lost that they were accepted. Their numbers are not given again.
constexpr int kMaxLostJobs = 1000;

Digest FromProto(const v1::Digest& digest) { return {digest.sha256(), digest.size_bytes()}; }

template <class List>
std::vector<NamedDigest> NamedDigests(const List& files) {
  std::vector<NamedDigest> result;
  for (const auto& file : files) result.push_back({file.name(), FromProto(file.digest())});
  return result;
}

PlannedTask FromProto(const v1::PlannedTaskRecord& record) {
  PlannedTask task;
  task.kind = record.kind();
  task.name = record.title();
  task.tile = record.tile();
  task.parameters = record.parameters_json();
  task.cost = record.cost();
  task.scale = record.scale();
  task.peak_bytes = record.peak_bytes();
  task.scene_files.assign(record.scene_files().begin(), record.scene_files().end());
  for (const auto& file : record.view_files()) {
    task.view_files.push_back({file.file(), file.view(), file.likelihoods()});
  }
  for (const auto& input : record.inputs()) {
    task.inputs.push_back({TaskId(input.task()), input.output(), input.has_tile() ? input.tile() : -1});
  }
  task.given = NamedDigests(record.given());
  return task;
}

}  // namespace

StatusOr<int> Ledger::FindJob(const std::string& name) const {
  TESSERA_ASSIGN_OR_RETURN(const int job, ParseJobName(name));
  if (job >= static_cast<int>(jobs_.size())) return absl::NotFoundError("no such job: " + name);
  return job;
}

StatusOr<TaskRef> Ledger::FindTask(const std::string& name) const {
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, ParseTaskName(name));
  if (ref.job >= static_cast<int>(jobs_.size()) || ref.task >= static_cast<int>(jobs_[ref.job].tasks.size())) {
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
  std::string message = "request " + request.id + " was used for " + header.name + ", and not for the same:";
  for (const std::string& difference : differences) message += "\n" + difference;
  return absl::AlreadyExistsError(message);
}

StatusOr<Digest> Ledger::InputDigest(const Job& job, const PlannedInput& input) const {
  const JobTask& producer = job.tasks[input.task.value()];
  for (const NamedDigest& output : producer.outputs) {
    if (output.name == input.output) return output.digest;
  }
  return absl::NotFoundError("no output " + input.output + " of '" + producer.plan.name + "' yet");
}

StatusOr<std::vector<NamedDigest>> Ledger::InputsOf(const Job& job, const PlannedTask& task) const {
  std::vector<NamedDigest> inputs;
  inputs.reserve(task.inputs.size() + task.scene_files.size() + task.view_files.size());
  for (const PlannedInput& input : task.inputs) {
    TESSERA_ASSIGN_OR_RETURN(const Digest digest, InputDigest(job, input));
    inputs.push_back({InputName(input), digest});
  }
  for (const int file : task.scene_files) {
    const NamedDigest& found = job.scene_files[file];
    inputs.push_back({std::string(kSceneFolder) + "/" + found.name, found.digest});
  }
  for (const PlannedTask::ViewFile& file : task.view_files) {
    inputs.push_back({ViewFileName(file.view, file.likelihoods), job.scene_files[file.file].digest});
  }
  return inputs;
}

const std::vector<NamedDigest>* Ledger::FindResult(const std::string& key) const {
  const auto it = task_of_key_.find(key);
  return it == task_of_key_.end() ? nullptr : &task(it->second).outputs;
}

std::vector<std::string> Ledger::SceneFilesWith(const Digest& digest) const {
  const auto it = scene_files_of_sha256_.find(digest.sha256);
  return it == scene_files_of_sha256_.end() ? std::vector<std::string>() : it->second;
}

StatusOr<TaskRef> Ledger::CheckCurrentAttempt(const std::string& name, int attempt) const {
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindTask(name));
  const JobTask& target = task(ref);
  if (HasEnded(jobs_[ref.job].header.state)) {
    return absl::FailedPreconditionError(name + ": its job has ended");
  }
  if (target.state != TaskState::kLeased || target.attempt() != attempt) {
    return absl::FailedPreconditionError(name + ": attempt " + std::to_string(attempt) + " is not the current one (" +
                                         std::to_string(target.attempt()) +
                                         (target.state == TaskState::kLeased ? ")" : ", not leased)"));
  }
  return ref;
}

Status Ledger::CheckAccepted(const v1::JobAccepted& change) const {
  TESSERA_ASSIGN_OR_RETURN(const int index, ParseJobName(change.job()));
  if (const int next = static_cast<int>(jobs_.size()); index < next || index > next + kMaxLostJobs) {
    return absl::FailedPreconditionError("the next job is " + JobName(next) + ", not " + change.job());
  }
  if (job_of_request_.contains(change.request_id())) {
    return absl::AlreadyExistsError("request " + change.request_id() + " has a job already");
  }
  TESSERA_RETURN_IF_ERROR(CheckPriority(change.priority()));
  std::set<std::string> names;
  for (const auto& file : change.scene_files()) {
    TESSERA_RETURN_IF_ERROR(CheckDigest(FromProto(file.digest())));
    if (!names.insert(file.path()).second) return absl::InvalidArgumentError("scene file named twice: " + file.path());
  }
  return absl::OkStatus();
}

Status Ledger::CheckPlanned(const v1::TasksPlanned& change) const {
  TESSERA_ASSIGN_OR_RETURN(const int index, FindJob(change.job()));
  const Job& job = jobs_[index];
  if (HasEnded(job.header.state)) return absl::FailedPreconditionError(change.job() + " has ended");
  if (change.tasks().empty()) return absl::InvalidArgumentError("a plan without tasks");
  int count = static_cast<int>(job.tasks.size());
  if (change.first_task() != count && (job.open_plan < 0 || change.first_task() != job.open_plan)) {
    return absl::FailedPreconditionError("plan of " + change.job() + " from task " +
                                         std::to_string(change.first_task()) + ", the next is " +
                                         std::to_string(count));
  }
  count = change.first_task();
  for (const int task : change.superseded()) {
    if (task < 0 || task >= count || job.tasks[task].superseded) {
      return absl::InvalidArgumentError("plan of " + change.job() + ": supersedes task " + std::to_string(task));
    }
  }
  for (const auto& planned : change.tasks()) {
    const auto fault = [&](const std::string& what) {
      return absl::InvalidArgumentError("plan of " + change.job() + ", '" + planned.title() + "': " + what);
    };
    std::set<std::string> names;
    if (planned.kind().empty()) return fault("no kind");
    if (!(planned.cost() >= 0)) return fault("cost is not a number of at least 0");
    for (const auto& output : planned.given()) TESSERA_RETURN_IF_ERROR(CheckDigest(FromProto(output.digest())));
    if (!planned.given().empty() &&
        planned.inputs_size() + planned.scene_files_size() + planned.view_files_size() > 0) {
      return fault("has inputs, though its outputs are given");
    }
    for (const auto& input : planned.inputs()) {
      const std::string name = InputName({TaskId(input.task()), input.output(), input.has_tile() ? input.tile() : -1});
      if (!names.insert(name).second) return fault("two inputs named " + name);
      if (input.task() < 0 || input.task() >= count) {
        return fault("input " + name + " comes from task " + std::to_string(input.task()) + ", which is not before it");
      }
    }
    for (int i = 0, last = -1; i < planned.scene_files_size(); last = planned.scene_files(i++)) {
      if (planned.scene_files(i) <= last || planned.scene_files(i) >= static_cast<int>(job.scene_files.size())) {
        return fault("scene file " + std::to_string(planned.scene_files(i)) + " of " +
                     std::to_string(job.scene_files.size()) + ", after " + std::to_string(last));
      }
    }
    for (const auto& file : planned.view_files()) {
      if (file.file() >= 0 && file.file() < static_cast<int>(job.scene_files.size()) && file.view() >= 0 &&
          names.insert(ViewFileName(file.view(), file.likelihoods())).second) {
        continue;
      }
      return fault("file " + std::to_string(file.file()) + " of view " + std::to_string(file.view()) + ", of " +
                   std::to_string(job.scene_files.size()) + " scene files");
    }
    ++count;
  }
  return absl::OkStatus();
}

Status Ledger::CheckStarted(const v1::AttemptStarted& change) const {
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindTask(change.task()));
  const JobTask& target = task(ref);
  if (HasEnded(jobs_[ref.job].header.state) || target.state != TaskState::kReady) {
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
    if (!names.insert(output.name()).second) return absl::InvalidArgumentError("two outputs named " + output.name());
  }
  if (!change.reused()) return CheckCurrentAttempt(change.task(), change.attempt()).status();
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindTask(change.task()));
  if (HasEnded(jobs_[ref.job].header.state) || task(ref).state != TaskState::kReady) {
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
  if (!HasEnded(static_cast<JobState>(change.state()))) return absl::InvalidArgumentError("not an end of a job");
  if (change.state() == v1::JOB_SUCCEEDED || change.state() == v1::JOB_PARTIAL) {
    if (job.set_aside.empty() != (change.state() == v1::JOB_SUCCEEDED)) {
      return absl::FailedPreconditionError(change.job() + ": " + std::to_string(job.set_aside.size()) +
                                           " tiles were set aside");
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
  job.header.warnings.assign(change.warnings().begin(), change.warnings().end());
  for (const auto& file : change.scene_files()) {
    job.scene_files.push_back({file.path(), FromProto(file.digest())});
    if (IsCarried(file.path())) continue;
    std::vector<std::string>& paths = scene_files_of_sha256_[file.digest().sha256()];
    const std::string path = change.scene_path() + "/" + file.path();
    if (std::find(paths.begin(), paths.end(), path) == paths.end()) paths.push_back(path);
  }
  std::sort(job.scene_files.begin(), job.scene_files.end(),
            [](const NamedDigest& a, const NamedDigest& b) { return a.name < b.name; });
  const int index = *ParseJobName(change.job());
  while (static_cast<int>(jobs_.size()) < index) {
    Job& lost = jobs_.emplace_back();
    lost.header.name = JobName(static_cast<int>(jobs_.size()) - 1);
    lost.header.state = JobState::kFailed;
    lost.header.error = "the record that it was accepted cannot be used; submit it again";
  }
  if (!change.request_id().empty()) job_of_request_[change.request_id()] = index;
  jobs_.push_back(std::move(job));
  active_jobs_.push_back(index);
  ready_.SetJob(index, change.priority(), /*paused=*/false);
  UpdateDue(index);
}

void Ledger::ApplyPlanned(const v1::TasksPlanned& change) {
  const int index = *FindJob(change.job());
  Job& job = jobs_[index];
  if (job.open_plan >= 0 && change.first_task() == job.open_plan) DropOpenPlan(job);
  if (job.open_plan < 0) job.open_plan = change.first_task();
  for (const auto& planned : change.tasks()) {
    JobTask added;
    added.plan = FromProto(planned);
    for (const PlannedInput& input : added.plan.inputs) {
      JobTask& producer = job.tasks[input.task.value()];
      producer.readers.push_back(static_cast<int>(job.tasks.size()));
      added.missing += producer.state != TaskState::kSucceeded;
      added.depth = std::max(added.depth, producer.depth + 1);
    }
    job.planned_to_end = job.planned_to_end || added.plan.kind == kPublishKind ||
                         (added.plan.kind == kPlanKind && job.header.settings.update.plan_only);
    if (!added.plan.given.empty()) {
      added.state = TaskState::kSucceeded;
      added.reused = true;
      added.outputs = added.plan.given;
    } else {
      ++job.unfinished;
    }
    job.totals.AddPlanned(added);
    job.tasks.push_back(std::move(added));
  }
  if (!change.more()) {
    for (const int task : change.superseded()) Supersede({index, task});
    if (!change.superseded().empty()) Recount(job);
    job.plans_anew = false;
    const int first = std::exchange(job.open_plan, -1);
    for (int task = first; task < static_cast<int>(job.tasks.size()); ++task) ReadyTask({index, task});
  }
  UpdateDue(index);
}

void Ledger::DropOpenPlan(Job& job) {
  const auto first = static_cast<size_t>(job.open_plan);
  for (size_t task = first; task < job.tasks.size(); ++task) {
    for (const PlannedInput& input : job.tasks[task].plan.inputs) {
      std::vector<int>& readers = job.tasks[input.task.value()].readers;
      while (!readers.empty() && readers.back() >= job.open_plan) readers.pop_back();
    }
  }
  for (size_t task = first; task < job.tasks.size(); ++task) job.unfinished -= job.tasks[task].plan.given.empty();
  job.tasks.resize(first);
  Recount(job);
  job.planned_to_end = job.plans_anew;
  job.open_plan = -1;
}

void Ledger::UpdateDue(int index) {
  const Job& job = jobs_[index];
  // Also where the records of a plan broke off.
  const bool due = job.tasks.empty() || job.unfinished == 0 || job.failed >= 0 || job.open_plan >= 0 ||
                   (job.plans_anew && CutsAreDone(job));
  if (due && !HasEnded(job.header.state)) {
    due_jobs_.insert(index);
  } else {
    due_jobs_.erase(index);
  }
}

void Ledger::ReadyTask(TaskRef ref) {
  const Job& job = jobs_[ref.job];
  JobTask& waiting = jobs_[ref.job].tasks[ref.task];
  if (waiting.state != TaskState::kWaiting || waiting.missing > 0 || job.open_plan >= 0) return;
  StatusOr<std::vector<NamedDigest>> inputs = InputsOf(job, waiting.plan);
  if (!inputs.ok()) return;
  inputs->resize(inputs->size() - waiting.plan.view_files.size());  // their content is told by others
  waiting.state = TaskState::kReady;
  waiting.key = TaskKey(algorithm_version_, waiting.plan.kind, waiting.plan.parameters, *inputs);
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
  target.state = TaskState::kSucceeded;
  --job.unfinished;
  target.key = change.key();
  target.reused = change.reused();
  target.outputs = NamedDigests(change.outputs());
  target.stats = change.stats_json();
  target.usage = {change.usage().core_seconds(), change.usage().peak_bytes(), change.usage().threads()};
  target.warnings.assign(change.warnings().begin(), change.warnings().end());
  target.end_us = time_us;
  if (change.reused()) {
    target.start_us = time_us;
  } else {
    target.attempts.back().end_us = time_us;
  }
  if (job.header.state == JobState::kQueued) {
    job.header.state = JobState::kRunning;
    job.header.start_us = time_us;
  }
  task_of_key_[change.key()] = ref;
  job.totals.AddSucceeded(ref.task, target);
  for (const int reader : target.readers) {
    --job.tasks[reader].missing;
    ReadyTask({ref.job, reader});
  }
  UpdateDue(ref.job);
}

void Ledger::ApplyFailed(const v1::AttemptFailed& change, int64_t time_us) {
  const TaskRef ref = *FindTask(change.task());
  Job& job = jobs_[ref.job];
  JobTask& target = job.tasks[ref.task];
  Attempt& attempt = target.attempts.back();
  attempt.end_us = time_us;
  attempt.failure = {static_cast<ErrorClass>(change.error().error_class()), change.error().message()};
  attempt.lease_expired = change.lease_expired();
  target.error = attempt.failure;
  target.retry_delay_us = change.retry_delay_us();
  if (change.retry_time_us() > time_us) target.retry_delay_us = change.retry_time_us() - time_us;
  target.state = change.final() ? TaskState::kFailed : TaskState::kReady;
  if (change.final()) {
    target.end_us = time_us;
    job.failed = job.failed < 0 ? ref.task : std::min(job.failed, ref.task);
    ready_.DropJob(ref.job);  // the job is about to end
    UpdateDue(ref.job);
  } else if (job.failed < 0) {
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
    if (each.state == TaskState::kLeased) each.attempts.back().end_us = time_us;
    each.state = TaskState::kCancelled;
    each.end_us = time_us;
  }
  active_jobs_.erase(std::find(active_jobs_.begin(), active_jobs_.end(), index));
  ready_.DropJob(index);
  UpdateDue(index);
}

}  // namespace tessera
