#include "server/ledger/ledger.h"

#include <algorithm>
#include <utility>

#include "common/job/task_parameters.h"
#include "server/ledger/digest_proto.h"
#include "server/ledger/task_inputs.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr int64_t kMaxRetryDelayUs = int64_t{86'400'000'000} * 365;
// Limits of predictions, so that sums over millions of tasks do not overflow.
constexpr int64_t kMaxPeakBytes = int64_t{1} << 46, kMaxStoredBytes = int64_t{1} << 40;
constexpr double kMaxCost = 1e12;

PlannedTask FromProto(const v1::PlannedTaskRecord& record) {
  PlannedTask task;
  task.kind = record.kind();
  task.name = record.title();
  task.tile = record.tile();
  task.parameters = record.parameters_json();
  task.cost = std::min(record.cost(), kMaxCost);
  task.scale = record.scale();
  task.later_cost = record.later_cost() > 0 ? std::min(record.later_cost(), kMaxCost) : 0;
  task.later_bytes = std::clamp(record.later_bytes(), int64_t{0}, kMaxStoredBytes);
  task.peak_bytes = std::clamp(record.peak_bytes(), int64_t{0}, kMaxPeakBytes);
  task.stored_bytes = std::clamp(record.stored_bytes(), int64_t{0}, kMaxStoredBytes);
  task.scene_files = std::vector<int>(record.scene_files().begin(), record.scene_files().end());
  for (const auto& file : record.view_files()) {
    task.view_files.Edit().push_back({file.file(), file.view(), file.likelihoods(), file.mask()});
  }
  for (const auto& input : record.inputs()) {
    task.inputs.push_back({TaskId(input.task()), input.output(), input.has_tile() ? input.tile() : -1});
  }
  task.given = NamedDigests(record.given());
  return task;
}

// Whether no phase follows the one with this task.
bool EndsPlan(const Job& job, const JobTask& task) {
  return task.plan.kind == kPublishKind || task.plan.kind == kExportKind ||
         (task.plan.kind == kPlanKind && job.header.settings.update.plan_only);
}

bool IsPlannedToEnd(const Job& job) {
  return std::any_of(job.tasks.begin(), job.tasks.end(),
                     [&](const JobTask& task) { return !task.superseded && EndsPlan(job, task); });
}

}  // namespace

StatusOr<int> Ledger::FindJob(const std::string& name) const {
  TESSERA_ASSIGN_OR_RETURN(const int job, ParseJobName(name));
  if (job >= static_cast<int>(jobs_.size())) return absl::NotFoundError("no such job: " + name);
  if (jobs_[job].deleted) return absl::NotFoundError(name + " was deleted");
  return job;
}

StatusOr<TaskRef> Ledger::FindTask(const std::string& name) const {
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, ParseTaskName(name));
  if (ref.job >= static_cast<int>(jobs_.size()) || jobs_[ref.job].deleted ||
      ref.task >= static_cast<int>(jobs_[ref.job].tasks.size())) {
    return absl::NotFoundError("no such task: " + name);
  }
  return ref;
}

Status Ledger::CheckVersion(int job, const std::string& then) const {
  const JobHeader& header = jobs_[job].header;
  if (header.algorithm_version == algorithm_version_) return absl::OkStatus();
  return absl::FailedPreconditionError(header.name + " was made by algorithm version " + header.algorithm_version +
                                       ", and this coordinator has " + algorithm_version_ + ": " + then);
}

void Ledger::Apply(const v1::Record& record) {
  ready_.NoteTime(record.time_us());
  switch (record.change_case()) {
    case v1::Record::kJobAccepted:
      return ApplyAccepted(record.job_accepted(), record.time_us());
    case v1::Record::kTasksPlanned:
      return ApplyPlanned(record.tasks_planned());
    case v1::Record::kAttemptStarted:
      return ApplyStarted(record.attempt_started(), record.time_us());
    case v1::Record::kTaskSucceeded:
      return ApplySucceeded(record.task_succeeded(), record.time_us());
    case v1::Record::kAttemptFailed:
      return ApplyFailed(record.attempt_failed(), record.time_us());
    case v1::Record::kJobEnded:
      return ApplyEnded(record.job_ended(), record.time_us());
    case v1::Record::kJobChanged:
      return ApplyChanged(record.job_changed());
    case v1::Record::kTileQuarantined:
      return ApplyQuarantined(record.tile_quarantined());
    case v1::Record::kJobRetried:
      return ApplyRetried(record.job_retried());
    case v1::Record::kResultLost:
      return ApplyLost(record.result_lost());
    case v1::Record::kJobDeleted:
      return ApplyDeleted(record.job_deleted());
    case v1::Record::kJobRestarted:
      return ApplyRestarted(record.job_restarted());
    case v1::Record::CHANGE_NOT_SET:
      return;
  }
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
  for (const auto& file : change.scene_files()) job.scene_files.push_back({file.path(), FromProto(file.digest())});
  std::sort(job.scene_files.begin(), job.scene_files.end(),
            [](const NamedDigest& a, const NamedDigest& b) { return a.name < b.name; });
  const int index = *ParseJobName(change.job());
  FillJobsUpTo(index);
  if (!change.request_id().empty()) job_of_request_[change.request_id()] = index;
  scene_files_.Add(job);
  jobs_.push_back(std::move(job));
  active_jobs_.push_back(index);
  ready_.SetJob(index, change.priority(), /*paused=*/false);
  UpdateDue(index);
}

// Adds the tasks of a plan to a job. A long plan is stored as several records; the last one makes its tasks ready.
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
    job.planned_to_end = job.planned_to_end || EndsPlan(job, added);
    if (!added.plan.given->empty()) {
      added.state = TaskState::kSucceeded;
      added.reused = true;
      added.outputs.assign(added.plan.given->begin(), added.plan.given->end());
    } else {
      ++job.unfinished;
    }
    if (added.plan.stored_bytes > 0) ready_.Hold(index);
    job.totals.AddPlanned(static_cast<int>(job.tasks.size()), added);
    job.tasks.push_back(std::move(added));
  }
  if (!change.more()) {
    for (const int task : change.superseded()) Supersede({index, task});
    if (!change.superseded().empty()) {
      Recount(job);
      job.planned_to_end = IsPlannedToEnd(job);
    }
    job.replan_from = -1;
    const int first = std::exchange(job.open_plan, -1);
    for (int task = first; task < static_cast<int>(job.tasks.size()); ++task) ReadyTask({index, task});
  }
  UpdateDue(index);
}

void Ledger::DropOpenPlan(Job& job) {
  const auto first = static_cast<size_t>(job.open_plan);
  for (size_t task = first; task < job.tasks.size(); ++task) {
    for (const PlannedInput& input : job.tasks[task].plan.inputs) {
      auto& readers = job.tasks[input.task.value()].readers;
      while (!readers.empty() && readers.back() >= job.open_plan) readers.pop_back();
    }
  }
  for (size_t task = first; task < job.tasks.size(); ++task) job.unfinished -= job.tasks[task].plan.given->empty();
  job.tasks.resize(first);
  Recount(job);
  job.planned_to_end = IsPlannedToEnd(job);
  job.open_plan = -1;
}

void Ledger::ApplyStarted(const v1::AttemptStarted& change, int64_t time_us) {
  const TaskRef ref = *FindTask(change.task());
  JobHeader& header = jobs_[ref.job].header;
  JobTask& target = jobs_[ref.job].tasks[ref.task];
  ready_.Remove(ref, target);
  target.state = TaskState::kLeased;
  target.attempts.push_back({change.worker(), change.machine(), time_us, 0, {}, false});
  target.attempts.back().after_end = HasEnded(header.state);
  jobs_[ref.job].totals.AddAttempt(target.plan.tile, 1, 0);
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
  results_.Remove(ref);
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
  results_.Add(ref);
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
  job.totals.AddAttempt(target.plan.tile, 0, 1);
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
  job.header.bad_input = change.bad_input();
  job.header.end_us = time_us;
  job.artifacts = NamedDigests(change.artifacts());
  for (JobTask& each : job.tasks) {
    if (each.superseded || each.state == TaskState::kSucceeded || each.state == TaskState::kFailed) continue;
    if (each.state == TaskState::kLeased) {
      each.attempts.back().end_us = time_us;
      each.attempts.back().cancelled = true;
    }
    each.state = TaskState::kCancelled;
    each.end_us = time_us;
  }
  job.totals.ForgetWork();
  active_jobs_.erase(std::find(active_jobs_.begin(), active_jobs_.end(), index));
  ready_.DropJob(index);
  UpdateDue(index);
}

void Ledger::ApplyChanged(const v1::JobChanged& change) {
  const int index = *FindJob(change.job());
  JobHeader& header = jobs_[index].header;
  if (change.has_priority()) header.priority = change.priority();
  if (change.has_paused()) header.paused = change.paused();
  ready_.SetJob(index, header.priority, header.paused);
}

void Ledger::UpdateDue(int index) {
  const Job& job = jobs_[index];
  // open_plan: the coordinator stopped between the records of a plan.
  const bool asks =
      job.tasks.empty() || job.unfinished == 0 || job.open_plan >= 0 || (job.replan_from >= 0 && CutsAreDone(job));
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

}  // namespace tessera
