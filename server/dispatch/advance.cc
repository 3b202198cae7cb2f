// What the coordinator does by itself, without a worker: plan, reuse what is known, end jobs.
#include <utility>

#include "server/dispatch/dispatcher.h"
#include "server/dispatch/job_report.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

namespace {

constexpr char kSurvey[] = "survey.json";  // the output of ingest that the plan is made from

void ToProto(const PlannedTask& task, v1::PlannedTaskRecord* record) {
  record->set_kind(task.kind);
  record->set_title(task.name);
  record->set_tile(task.tile);
  record->set_parameters_json(task.parameters);
  record->set_cost(task.cost);
  record->set_peak_bytes(task.peak_bytes);
  record->mutable_scene_files()->Add(task.scene_files.begin(), task.scene_files.end());
  for (const PlannedInput& input : task.inputs) {
    v1::PlannedInputRecord& added = *record->add_inputs();
    added.set_name(input.name);
    added.set_task(input.task);
    added.set_output(input.output);
  }
}

}  // namespace

struct Dispatcher::PendingStep {
  enum class Kind { kPlanIngest, kPlanTiles, kEnd };
  Kind kind = Kind::kEnd;
  int job = -1;
  int tasks = 0;  // when the step was found; a plan for another number is stale
  JobSettings settings;
  std::vector<std::string> scene_files;
  StatusOr<Digest> survey = absl::UnknownError("not read");
  std::string error;   // of a job that ends
  std::string report;  // job.json
  std::vector<NamedDigest> artifacts;
};

Status Dispatcher::Tick() {
  {
    std::lock_guard lock(mutex_);
    TESSERA_RETURN_IF_ERROR(ExpireLeasesLocked());
    leases_.ForgetSilentWorkers(environment_.clock->MonotonicUs() -
                                static_cast<int64_t>(options_.forget_worker_s * 1e6));
  }
  return Advance();
}

Status Dispatcher::Advance() {
  std::lock_guard one_at_a_time(advance_mutex_);
  while (true) {
    TESSERA_RETURN_IF_ERROR(ReuseReady());
    std::optional<PendingStep> step;
    {
      std::lock_guard lock(mutex_);
      step = NextStepLocked();
    }
    if (!step) return absl::OkStatus();
    TESSERA_RETURN_IF_ERROR(step->kind == PendingStep::Kind::kEnd ? EndJob(*step) : PlanJob(*step));
  }
}

std::optional<Dispatcher::PendingStep> Dispatcher::NextStepLocked() const {
  for (const int index : ledger_.active_jobs()) {
    const Job& job = ledger_.jobs()[index];
    PendingStep step;
    step.job = index;
    step.tasks = static_cast<int>(job.tasks.size());
    step.settings = job.header.settings;
    if (job.tasks.empty()) {
      step.kind = PendingStep::Kind::kPlanIngest;
      for (const NamedDigest& file : job.scene_files) step.scene_files.push_back(file.name);
      return step;
    }
    bool all_succeeded = true;
    for (const JobTask& task : job.tasks) {
      all_succeeded = all_succeeded && task.state == TaskState::kSucceeded;
      if (task.state == TaskState::kFailed && step.error.empty()) {
        step.error = task.plan.name + ": " + task.error.message;
        if (task.error.error_class != ErrorClass::kInput) {
          step.error +=
              " (" + ErrorClassName(task.error.error_class) + ", attempt " + std::to_string(task.attempt()) + ")";
        }
      }
    }
    if (step.error.empty() && job.tasks.size() == 1 && all_succeeded) {
      step.kind = PendingStep::Kind::kPlanTiles;
      step.survey = ledger_.InputDigest(job, {kSurvey, 0, kSurvey});
      for (const NamedDigest& file : job.scene_files) step.scene_files.push_back(file.name);
      return step;
    }
    if (step.error.empty() && !all_succeeded) continue;
    for (const JobTask& task : job.tasks) {
      if (task.plan.kind != "publish") continue;
      step.artifacts.insert(step.artifacts.end(), task.outputs.begin(), task.outputs.end());
    }
    if (!step.error.empty()) step.artifacts.clear();
    step.report = JobReportJson(job, step.error, environment_.clock->UnixTimeUs());
    return step;
  }
  return std::nullopt;
}

Status Dispatcher::PlanJob(const PendingStep& step) {
  StatusOr<std::vector<PlannedTask>> tasks = std::vector<PlannedTask>();
  if (step.kind == PendingStep::Kind::kPlanIngest) {
    StatusOr<PlannedTask> ingest = environment_.planner->Ingest(step.settings, step.scene_files);
    if (ingest.ok()) {
      tasks->push_back(*std::move(ingest));
    } else {
      tasks = ingest.status();
    }
  } else if (!step.survey.ok()) {
    tasks = step.survey.status();
  } else {
    const StatusOr<std::string> survey = environment_.blobs->Read(*step.survey);
    tasks = survey.ok() ? environment_.planner->Tiles(step.settings, *survey, step.scene_files) : survey.status();
  }
  std::lock_guard lock(mutex_);
  const Job& job = ledger_.jobs()[step.job];
  if (HasEnded(job.header.state) || static_cast<int>(job.tasks.size()) != step.tasks) return absl::OkStatus();
  v1::Record record;
  record.mutable_tasks_planned()->set_job(job.header.name);
  Status fault = tasks.status();
  if (fault.ok()) {
    for (const PlannedTask& task : *tasks) ToProto(task, record.mutable_tasks_planned()->add_tasks());
    fault = ledger_.Check(record);
  }
  if (!fault.ok()) {
    return EndJobLocked(step.job, JobState::kFailed, "cannot plan the job: " + std::string(fault.message()), {});
  }
  return CommitLocked(record);
}

Status Dispatcher::EndJob(const PendingStep& step) {
  std::vector<NamedDigest> artifacts = step.artifacts;
  TESSERA_ASSIGN_OR_RETURN(const Digest report, environment_.blobs->PutBytes(step.report));
  artifacts.push_back({"job.json", report});
  std::lock_guard lock(mutex_);
  if (HasEnded(ledger_.jobs()[step.job].header.state)) return absl::OkStatus();
  return EndJobLocked(step.job, step.error.empty() ? JobState::kSucceeded : JobState::kFailed, step.error, artifacts);
}

Status Dispatcher::EndJobLocked(int job, JobState state, const std::string& error,
                                const std::vector<NamedDigest>& artifacts) {
  v1::Record record;
  v1::JobEnded& ended = *record.mutable_job_ended();
  ended.set_job(ledger_.jobs()[job].header.name);
  ended.set_state(static_cast<v1::JobState>(state));
  ended.set_error(error);
  for (const NamedDigest& artifact : artifacts) {
    v1::Artifact& added = *ended.add_artifacts();
    added.set_name(artifact.name);
    added.mutable_digest()->set_sha256(artifact.digest.sha256);
    added.mutable_digest()->set_size_bytes(artifact.digest.size_bytes);
  }
  TESSERA_RETURN_IF_ERROR(CommitLocked(record));
  leases_.DropJob(job);  // their next heartbeats tell the workers
  return absl::OkStatus();
}

StatusOr<bool> Dispatcher::ReuseLocked(TaskRef ref) {
  const JobTask& task = ledger_.task(ref);
  const std::vector<NamedDigest>* outputs = ledger_.FindResult(task.key);
  if (outputs == nullptr) return false;
  v1::Record record;
  v1::TaskSucceeded& succeeded = *record.mutable_task_succeeded();
  for (const NamedDigest& output : *outputs) {
    if (!environment_.blobs->Has(output.digest)) return false;
    v1::OutputFile& added = *succeeded.add_outputs();
    added.set_name(output.name);
    added.mutable_digest()->set_sha256(output.digest.sha256);
    added.mutable_digest()->set_size_bytes(output.digest.size_bytes);
  }
  succeeded.set_task(TaskName(ref));
  succeeded.set_key(task.key);
  succeeded.set_reused(true);
  TESSERA_RETURN_IF_ERROR(CommitLocked(record));
  return true;
}

Status Dispatcher::ReuseReady() {
  std::lock_guard lock(mutex_);
  // Producers come before their readers in a plan, so one pass follows a chain of known results to its end.
  for (const int job : ledger_.active_jobs()) {
    for (int i = 0; i < static_cast<int>(ledger_.jobs()[job].tasks.size()); ++i) {
      const JobTask& task = ledger_.jobs()[job].tasks[i];
      if (task.state != TaskState::kReady || task.attempt() > 0) continue;
      TESSERA_RETURN_IF_ERROR(ReuseLocked({job, i}).status());
    }
  }
  return absl::OkStatus();
}

}  // namespace tessera
