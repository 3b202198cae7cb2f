// What the coordinator does by itself, without a worker: plan, reuse what is known, end jobs.
#include <algorithm>
#include <iterator>
#include <map>
#include <utility>

#include "common/base/printable.h"
#include "common/job/task_parameters.h"
#include "server/jobs/dispatcher.h"
#include "server/jobs/job_report.h"
#include "server/jobs/pending_step.h"
#include "server/jobs/set_aside.h"
#include "server/ledger/digest_proto.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

namespace {

constexpr size_t kMaxPlanBytes = 512 << 10;  // of the tasks in one record, which is applied at once
constexpr char kJobFile[] = "job.json";
constexpr int64_t kRecordsAhead = 8;                  // of a plan, that are not stored yet
constexpr int kReportedAtOnce = 256;                  // tasks
constexpr int64_t kMaxReadsBytes = int64_t{1} << 20;  // of a tile's kReadsFile

void ToProto(const PlannedTask& task, v1::PlannedTaskRecord* record) {
  record->set_kind(task.kind);
  record->set_title(task.name);
  record->set_tile(task.tile);
  record->set_parameters_json(task.parameters);
  record->set_cost(task.cost);
  record->set_scale(task.scale);
  record->set_peak_bytes(task.peak_bytes);
  record->set_stored_bytes(task.stored_bytes);
  record->mutable_scene_files()->Add(task.scene_files->begin(), task.scene_files->end());
  for (const PlannedTask::ViewFile& file : *task.view_files) {
    v1::ViewFileRecord& added = *record->add_view_files();
    added.set_file(file.file);
    added.set_view(file.view);
    added.set_likelihoods(file.likelihoods);
  }
  for (const PlannedInput& input : task.inputs) {
    v1::PlannedInputRecord& added = *record->add_inputs();
    added.set_task(input.task.value());
    added.set_output(input.output);
    if (input.tile >= 0) added.set_tile(input.tile);
  }
  AddFiles(*task.given, record->mutable_given());
}

}  // namespace

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
  advance_wanted_ = true;
  while (advance_wanted_) {
    // Whoever is at it now sees to what is wanted.
    const std::unique_lock one_at_a_time(advance_mutex_, std::try_to_lock);
    if (!one_at_a_time) return absl::OkStatus();
    advance_wanted_ = false;
    while (true) {
      TESSERA_RETURN_IF_ERROR(ReuseReady());
      std::optional<PendingStep> step;
      {
        std::lock_guard lock(mutex_);
        step = NextStepLocked();
      }
      if (!step) break;
      TESSERA_RETURN_IF_ERROR(step->kind == PendingStep::Kind::kEnd        ? EndJob(*step)
                              : step->kind == PendingStep::Kind::kSetAside ? SetTileAside(*step)
                                                                           : PlanJob(*step));
    }
    AdmitHeld();
  }
  return absl::OkStatus();
}

std::optional<Dispatcher::PendingStep> Dispatcher::NextStepLocked() const {
  if (ledger_.due_jobs().empty()) return std::nullopt;
  const int index = *ledger_.due_jobs().begin();
  const Job& job = ledger_.jobs()[index];
  PendingStep step;
  step.job = index;
  if (job.failed >= 0) {
    const JobTask& task = job.tasks[job.failed];
    if (CanGoOnWithout(job)) {
      step.kind = PendingStep::Kind::kSetAside;
      step.failed = job.failed;
      return step;
    }
    step.error = task.plan.name + ": " + task.error->message;
    if (task.error->error_class != ErrorClass::kInput) {
      step.error +=
          " (" + ErrorClassName(task.error->error_class) + ", attempt " + std::to_string(task.attempt()) + ")";
    }
  } else if (!job.lost_error.empty()) {
    step.error = job.lost_error;
  } else if (job.open_plan >= 0 || !job.planned_to_end || (job.plans_anew && CutsAreDone(job))) {
    step.set_aside = TilesSetAside(job);
    if (job.plans_anew) step.replaces_from = FirstBehindCuts(job);
    step.settings = job.header.settings;
    step.scene_files = job.scene_files;
    step.tasks = job.open_plan >= 0 ? job.open_plan : static_cast<int>(job.tasks.size());
    const std::string& base = step.settings.update.base;
    if (!base.empty()) step.base = ledger_.BaseOf(step.settings.update);
    for (int task = 0; task < step.tasks; ++task) {
      const TaskPhase phase = KindOf(job.tasks[task].plan.kind.str()).phase;
      if (phase == TaskPhase::kSurvey) {
        step.survey = ledger_.InputDigest(job, {TaskId(task), kSurveyFile});
        step.kind = PendingStep::Kind::kPlanTiles;
      } else if (phase == TaskPhase::kCut) {
        step.tiles = std::max(step.tiles, job.tasks[task].plan.tile + 1);
        step.kind = PendingStep::Kind::kPlanSteps;
        if (job.tasks[task].superseded) continue;
        step.reads.emplace_back(job.tasks[task].plan.tile, ledger_.InputDigest(job, {TaskId(task), kReadsFile}));
      }
    }
    if (step.tasks == 0) step.kind = base.empty() ? PendingStep::Kind::kPlanIngest : PendingStep::Kind::kPlanUpdate;
    return step;
  } else {
    for (const JobTask& task : job.tasks) {
      if (task.superseded || !KindOf(task.plan.kind.str()).makes_artifacts) continue;
      for (const StoredFile& file : task.outputs) {
        if (file.name != kOutdatedFile) step.artifacts.push_back(file);  // that one is publish's input
      }
    }
    step.end = job.set_aside.empty() ? JobState::kSucceeded : JobState::kPartial;
    for (const SetAside& tile : job.set_aside) {
      step.error += (step.error.empty() ? "" : "\n") + SetAsideWords(job, tile);
    }
  }
  for (const SetAside& tile : job.set_aside) step.why_set_aside[tile.tile] = SetAsideWords(job, tile);
  step.header = job.header;
  step.tasks = static_cast<int>(job.tasks.size());
  return step;
}

StatusOr<std::vector<PlannedTask>> Dispatcher::PlanPhase(const PendingStep& step) const {
  Planner& planner = *environment_.planner;
  std::vector<std::string> names;
  for (const NamedDigest& file : step.scene_files) names.push_back(file.name);
  if (step.kind == PendingStep::Kind::kPlanIngest) {
    TESSERA_ASSIGN_OR_RETURN(PlannedTask ingest, planner.Ingest(step.settings, names));
    return std::vector<PlannedTask>{std::move(ingest)};
  }
  std::optional<UpdateBase> base;
  if (step.base) {
    TESSERA_RETURN_IF_ERROR(step.base->status());
    base = **step.base;
    TESSERA_ASSIGN_OR_RETURN(base->survey_json, environment_.blobs->Read(base->survey));
  }
  if (step.kind == PendingStep::Kind::kPlanUpdate) return planner.Update(step.settings, step.scene_files, *base);
  TESSERA_RETURN_IF_ERROR(step.survey.status());
  TESSERA_ASSIGN_OR_RETURN(const std::string survey, environment_.blobs->Read(*step.survey));
  const UpdateBase* const goes_on_from = base ? &*base : nullptr;
  if (step.kind == PendingStep::Kind::kPlanTiles) return planner.Tiles(step.settings, survey, names, goes_on_from);
  std::vector<TileReads> reads;
  // An update has its base's tiles, and may have more behind them, which are cut.
  const int tiles = std::max(step.tiles, static_cast<int>(base ? base->tiles.size() : 0));
  const auto read = [&](int tile, const StatusOr<Digest>& digest) -> StatusOr<TileReads> {
    TESSERA_RETURN_IF_ERROR(digest.status());
    TESSERA_ASSIGN_OR_RETURN(const std::string json, environment_.blobs->Read(*digest, kMaxReadsBytes));
    return ParseTileReads(json, tile, tiles);
  };
  for (const auto& [tile, digest] : step.reads) {
    const StatusOr<TileReads> of_tile = read(tile, digest);
    if (!of_tile.ok()) {
      return Status(of_tile.status().code(),
                    "tile " + std::to_string(tile) + ": " + std::string(of_tile.status().message()));
    }
    reads.push_back(*of_tile);
  }
  return planner.Steps(step.settings, survey, names, reads, goes_on_from, step.set_aside);
}

Status Dispatcher::PlanJob(const PendingStep& step) {
  StatusOr<std::vector<PlannedTask>> tasks = PlanPhase(step);
  if (!tasks.ok()) {
    const StatusOr<bool> waits = RemakeForPlan(step);
    if (waits.ok() && *waits) return absl::OkStatus();
    const bool for_good = absl::IsFailedPrecondition(waits.status()) || absl::IsNotFound(waits.status());
    if (!waits.ok() && !for_good) return waits.status();  // Tick tries again and tells
    if (!waits.ok()) tasks = waits.status();
  }
  if (tasks.ok() && tasks->empty()) tasks = absl::InternalError("the plan has no tasks");
  const std::shared_lock refers(blobs_mutex_);
  for (size_t t = 0; tasks.ok() && t < tasks->size(); ++t) {
    for (const auto& [name, content] : *(*tasks)[t].given_contents) {
      TESSERA_ASSIGN_OR_RETURN(const Digest digest, environment_.blobs->PutBytes(content));
      (*tasks)[t].given.Edit().push_back({name, digest});
    }
  }
  Status fault = tasks.status();
  std::vector<int> superseded;
  if (fault.ok() && step.replaces_from >= 0) {
    PlanChange change = ChangePlan(step.replaces_from, TasksFrom(step), *std::move(tasks));
    tasks = std::move(change.added);
    superseded = std::move(change.superseded);
  }
  int first_task = step.tasks;
  for (size_t next = 0; fault.ok() && next < tasks->size();) {
    v1::Record record;
    v1::TasksPlanned& planned = *record.mutable_tasks_planned();
    planned.set_job(JobName(step.job));
    planned.set_first_task(first_task);
    for (size_t bytes = 0; next < tasks->size() && bytes < kMaxPlanBytes; ++next) {
      const PlannedTask task = std::move((*tasks)[next]);  // plans are large: it goes here
      ToProto(task, planned.add_tasks());
      bytes += planned.tasks(planned.tasks_size() - 1).ByteSizeLong();
    }
    planned.set_more(next < tasks->size());
    // A plan is made faster than it is stored, and not all of its records need wait in memory.
    journal_.Wait(journal_.last() - kRecordsAhead).IgnoreError();
    if (!planned.more()) planned.mutable_superseded()->Add(superseded.begin(), superseded.end());
    std::lock_guard lock(mutex_);
    const Job& job = ledger_.jobs()[step.job];
    const int at = first_task == step.tasks && job.open_plan >= 0 ? job.open_plan : static_cast<int>(job.tasks.size());
    if (HasEnded(job.header.state) || at != first_task || TilesSetAside(job) != step.set_aside) return absl::OkStatus();
    first_task += planned.tasks_size();
    fault = CommitLocked(record);
    if (!fault.ok() || planned.more()) continue;
    for (const int task : superseded) leases_.Release({step.job, task});  // their next heartbeats tell the workers
  }
  if (fault.ok()) return absl::OkStatus();
  std::lock_guard lock(mutex_);
  const Job& job = ledger_.jobs()[step.job];
  if (HasEnded(job.header.state)) return absl::OkStatus();
  std::string error = "cannot plan the job: " + std::string(fault.message());
  for (const SetAside& tile : job.set_aside) error += "\n" + SetAsideWords(job, tile);
  return EndJobLocked(step.job, JobState::kFailed, error, {});
}

// Under the mutex tasks are only copied, a few at once.
std::vector<KnownTask> Dispatcher::TasksFrom(const PendingStep& step) const {
  std::vector<KnownTask> known;
  for (int first = step.replaces_from; first < step.tasks; first += kReportedAtOnce) {
    std::lock_guard lock(mutex_);
    const std::deque<JobTask>& all = ledger_.jobs()[step.job].tasks;
    const int end = std::min({first + kReportedAtOnce, step.tasks, static_cast<int>(all.size())});
    for (int i = first; i < end; ++i) known.push_back({all[i].plan, all[i].superseded});
  }
  return known;
}

StatusOr<Digest> Dispatcher::StoreReport(const PendingStep& step) {
  // Under the mutex tasks are only copied, a few at once.
  const auto visit = [&](const std::function<void(const JobTask&)>& visitor) {
    for (int first = 0; first < step.tasks; first += kReportedAtOnce) {
      std::vector<JobTask> tasks;
      {
        std::lock_guard lock(mutex_);
        const std::deque<JobTask>& all = ledger_.jobs()[step.job].tasks;
        const int end = std::min(first + kReportedAtOnce, step.tasks);
        if (end > static_cast<int>(all.size())) return;  // cancelled and deleted meanwhile
        tasks.assign(all.begin() + first, all.begin() + end);
      }
      for (JobTask& task : tasks) {
        const auto after_end = [](const Attempt& attempt) { return attempt.after_end; };
        task.attempts.erase(std::remove_if(task.attempts.begin(), task.attempts.end(), after_end), task.attempts.end());
        visitor(task);
      }
    }
  };
  JobReport report(step.header, step.end, step.error, step.why_set_aside, step.end_us);
  visit([&](const JobTask& task) { report.Count(task); });
  return environment_.blobs->PutParts([&](const BlobStore::Writer& write) {
    write(report.Head());
    visit([&](const JobTask& task) { write(report.Line(task)); });
    write(JobReport::Tail());
  });
}

Status Dispatcher::EndJob(PendingStep step) {
  step.end_us = environment_.clock->UnixTimeUs();
  const std::shared_lock refers(blobs_mutex_);
  std::vector<NamedDigest> artifacts = step.artifacts;
  TESSERA_ASSIGN_OR_RETURN(const Digest report, StoreReport(step));
  artifacts.push_back({kJobFile, report});
  std::lock_guard lock(mutex_);
  if (HasEnded(ledger_.jobs()[step.job].header.state)) return absl::OkStatus();
  return EndJobLocked(step.job, step.end, step.error, artifacts, step.end_us);
}

Status Dispatcher::RestoreReport(int index, const Digest& digest) {
  PendingStep step;
  {
    std::lock_guard lock(mutex_);
    const Job& job = ledger_.jobs()[index];
    const NamedDigest report = {kJobFile, digest};
    const auto& artifacts = job.header.artifacts;
    if (std::find(artifacts.begin(), artifacts.end(), report) == artifacts.end()) {
      return absl::NotFoundError("not the report of " + job.header.name);
    }
    if (job.lost > 0)
      return absl::UnavailableError("results of " + job.header.name + " are being made again; ask later");
    step.job = index;
    step.header = job.header;
    step.end = job.header.state;
    step.end_us = job.header.end_us;
    step.error = job.header.error;
    step.tasks = static_cast<int>(job.tasks.size());
    for (const SetAside& tile : job.set_aside) step.why_set_aside[tile.tile] = SetAsideWords(job, tile);
  }
  TESSERA_ASSIGN_OR_RETURN(const Digest again, StoreReport(step));
  if (again == digest) return absl::OkStatus();
  return absl::FailedPreconditionError(std::string(kJobFile) + " of " + step.header.name +
                                       " is lost, and would have other bytes now: an earlier release wrote it");
}

Status Dispatcher::SetTileAside(const PendingStep& step) {
  std::lock_guard lock(mutex_);
  const Job& job = ledger_.jobs()[step.job];
  if (HasEnded(job.header.state) || job.failed != step.failed) return absl::OkStatus();
  v1::Record record;
  v1::TileSetAside& change = *record.mutable_tile_set_aside();
  change.set_job(job.header.name);
  change.set_tile(job.tasks[step.failed].plan.tile);
  change.set_task(step.failed);
  return CommitLocked(record);
}

Status Dispatcher::EndJobLocked(int job, JobState state, const std::string& error,
                                const std::vector<NamedDigest>& artifacts, int64_t time_us) {
  v1::Record record;
  record.set_time_us(time_us);
  v1::JobEnded& ended = *record.mutable_job_ended();
  ended.set_job(ledger_.jobs()[job].header.name);
  ended.set_state(static_cast<v1::JobState>(state));
  ended.set_error(AsUtf8(error));  // what libraries say of files may be anything
  AddFiles(artifacts, ended.mutable_artifacts());
  TESSERA_RETURN_IF_ERROR(CommitLocked(record));
  end_records_[job] = journal_.last();
  leases_.DropJob(job);  // their next heartbeats tell the workers
  return absl::OkStatus();
}

bool Dispatcher::MayReuseLocked(TaskRef ref) const {
  if (ledger_.WasDeleted(ref.job)) return false;
  const JobTask& task = ledger_.task(ref);
  if (task.state != TaskState::kReady || task.attempt() > 0) return false;
  const auto* outputs = ledger_.FindResult(*task.key);
  return outputs != nullptr && (!task.remaking || *outputs == task.outputs);
}

Status Dispatcher::Reuse(TaskRef ref) {
  const std::shared_lock refers(blobs_mutex_);
  Sha256 key;
  absl::InlinedVector<StoredFile, 1> outputs;
  {
    std::lock_guard lock(mutex_);
    if (!MayReuseLocked(ref)) return absl::OkStatus();
    key = *ledger_.task(ref).key;
    outputs = *ledger_.FindResult(key);
  }
  const bool stored = std::all_of(outputs.begin(), outputs.end(),
                                  [&](const StoredFile& output) { return environment_.blobs->Has(output.digest()); });
  std::lock_guard lock(mutex_);
  if (!MayReuseLocked(ref)) return absl::OkStatus();
  if (!stored) {
    ledger_.ForgetResult(key);
    return absl::OkStatus();
  }
  v1::Record record;
  v1::TaskSucceeded& succeeded = *record.mutable_task_succeeded();
  succeeded.set_task(TaskName(ref));
  succeeded.set_key(key.Hex());
  succeeded.set_reused(true);
  AddFiles(outputs, succeeded.mutable_outputs());
  return CommitLocked(record);
}

Status Dispatcher::ReuseReady() {
  // Each reuse may make readers ready, which come into the list again: a chain of known results is followed to its end.
  while (true) {
    std::vector<TaskRef> known;
    {
      std::lock_guard lock(mutex_);
      known = ledger_.TakeNewlyReady();
      if (known.empty()) return absl::OkStatus();
      std::erase_if(known, [&](TaskRef ref) { return !MayReuseLocked(ref); });
    }
    for (const TaskRef ref : known) TESSERA_RETURN_IF_ERROR(Reuse(ref));
  }
}

}  // namespace tessera
