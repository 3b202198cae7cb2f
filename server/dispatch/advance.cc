// What the coordinator does by itself, without a worker: plan, reuse what is known, end jobs.
#include <utility>

#include "common/tile/task_parameters.h"
#include "server/dispatch/dispatcher.h"
#include "server/dispatch/job_report.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

namespace {

constexpr size_t kMaxPlanBytes = 4 << 20;             // of the tasks in one record
constexpr int64_t kMaxReadsBytes = int64_t{1} << 20;  // of a tile's kReadsFile

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
    added.set_task(input.task.value());
    added.set_output(input.output);
    if (input.tile >= 0) added.set_tile(input.tile);
  }
}

}  // namespace

struct Dispatcher::PendingStep {
  enum class Kind { kPlanIngest, kPlanTiles, kPlanSteps, kEnd };
  Kind kind = Kind::kEnd;
  int job = -1;
  int tasks = 0;  // before the phase that is to be planned; a plan for another number is stale
  JobSettings settings;
  std::vector<std::string> scene_files;
  StatusOr<Digest> survey = absl::UnknownError("not read");
  std::vector<StatusOr<Digest>> reads;  // kReadsFile of each tile
  std::string error;                    // of a job that ends
  std::string report;                   // job.json
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
  if (ledger_.due_jobs().empty()) return std::nullopt;
  const int index = *ledger_.due_jobs().begin();
  const Job& job = ledger_.jobs()[index];
  PendingStep step;
  step.job = index;
  if (job.failed >= 0) {
    const JobTask& task = job.tasks[job.failed];
    step.error = task.plan.name + ": " + task.error.message;
    if (task.error.error_class != ErrorClass::kInput) {
      step.error += " (" + ErrorClassName(task.error.error_class) + ", attempt " + std::to_string(task.attempt()) + ")";
    }
  } else if (job.open_plan >= 0 || !job.planned_to_end) {
    step.settings = job.header.settings;
    for (const NamedDigest& file : job.scene_files) step.scene_files.push_back(file.name);
    step.tasks = job.open_plan >= 0 ? job.open_plan : static_cast<int>(job.tasks.size());
    step.kind = step.tasks == 0   ? PendingStep::Kind::kPlanIngest
                : step.tasks == 1 ? PendingStep::Kind::kPlanTiles
                                  : PendingStep::Kind::kPlanSteps;
    if (step.tasks == 0) return step;
    step.survey = ledger_.InputDigest(job, {TaskId(0), kSurveyFile});
    for (int task = 1; task < step.tasks; ++task) {
      if (job.tasks[task].plan.kind != kCutKind) continue;
      step.reads.push_back(ledger_.InputDigest(job, {TaskId(task), kReadsFile}));
    }
    return step;
  } else {
    for (const JobTask& task : job.tasks) {
      if (task.plan.kind != kPublishKind) continue;
      step.artifacts.insert(step.artifacts.end(), task.outputs.begin(), task.outputs.end());
    }
  }
  step.report = JobReportJson(job, step.error, environment_.clock->UnixTimeUs());
  return step;
}

StatusOr<std::vector<PlannedTask>> Dispatcher::PlanPhase(const PendingStep& step) const {
  Planner& planner = *environment_.planner;
  if (step.kind == PendingStep::Kind::kPlanIngest) {
    TESSERA_ASSIGN_OR_RETURN(PlannedTask ingest, planner.Ingest(step.settings, step.scene_files));
    return std::vector<PlannedTask>{std::move(ingest)};
  }
  TESSERA_RETURN_IF_ERROR(step.survey.status());
  TESSERA_ASSIGN_OR_RETURN(const std::string survey, environment_.blobs->Read(*step.survey));
  if (step.kind == PendingStep::Kind::kPlanTiles) return planner.Tiles(step.settings, survey, step.scene_files);
  std::vector<TileReads> reads;
  for (const StatusOr<Digest>& digest : step.reads) {
    const int tile = static_cast<int>(reads.size());
    const StatusOr<TileReads> of_tile = [&]() -> StatusOr<TileReads> {
      TESSERA_RETURN_IF_ERROR(digest.status());
      TESSERA_ASSIGN_OR_RETURN(const std::string json, environment_.blobs->Read(*digest, kMaxReadsBytes));
      return ParseTileReads(json, tile, static_cast<int>(step.reads.size()));
    }();
    if (!of_tile.ok()) {
      return Status(of_tile.status().code(),
                    "tile " + std::to_string(tile) + ": " + std::string(of_tile.status().message()));
    }
    reads.push_back(*of_tile);
  }
  return planner.Steps(step.settings, survey, step.scene_files, reads);
}

Status Dispatcher::PlanJob(const PendingStep& step) {
  StatusOr<std::vector<PlannedTask>> tasks = PlanPhase(step);
  if (tasks.ok() && tasks->empty()) tasks = absl::InternalError("the plan has no tasks");
  std::lock_guard lock(mutex_);
  const Job& job = ledger_.jobs()[step.job];
  const int at = job.open_plan >= 0 ? job.open_plan : static_cast<int>(job.tasks.size());
  if (HasEnded(job.header.state) || at != step.tasks) return absl::OkStatus();
  Status fault = tasks.status();
  for (size_t next = 0; fault.ok() && next < tasks->size();) {
    v1::Record record;
    v1::TasksPlanned& planned = *record.mutable_tasks_planned();
    planned.set_job(job.header.name);
    planned.set_first_task(next == 0 ? step.tasks : static_cast<int>(job.tasks.size()));
    for (size_t bytes = 0; next < tasks->size() && bytes < kMaxPlanBytes; ++next) {
      ToProto((*tasks)[next], planned.add_tasks());
      bytes += planned.tasks(planned.tasks_size() - 1).ByteSizeLong();
      (*tasks)[next] = PlannedTask();  // plans are large
    }
    planned.set_more(next < tasks->size());
    fault = ledger_.Check(record);
    if (fault.ok()) TESSERA_RETURN_IF_ERROR(CommitLocked(record));
  }
  if (fault.ok()) return absl::OkStatus();
  return EndJobLocked(step.job, JobState::kFailed, "cannot plan the job: " + std::string(fault.message()), {});
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
  // Each reuse may make readers ready, which come into the list again: a chain of known results is followed to its end.
  while (true) {
    std::vector<TaskRef> ready = ledger_.TakeNewlyReady();
    if (ready.empty()) return absl::OkStatus();
    for (const TaskRef ref : ready) {
      const JobTask& task = ledger_.task(ref);
      if (task.state != TaskState::kReady || task.attempt() > 0) continue;
      TESSERA_RETURN_IF_ERROR(ReuseLocked(ref).status());
    }
  }
}

}  // namespace tessera
