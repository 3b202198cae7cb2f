#include "server/jobs/planning_loop.h"

#include <algorithm>
#include <optional>
#include <shared_mutex>
#include <utility>
#include <vector>

#include "common/base/parallel.h"
#include "server/jobs/job_records.h"
#include "server/jobs/tile_quarantine.h"
#include "server/leases/known_results.h"
#include "server/ledger/digest_proto.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr size_t kMaxPlanBytes = 512 << 10;  // of one record, which is applied under one hold of the mutex
constexpr int64_t kRecordsAhead = 8;         // records of a plan that wait to be stored
constexpr size_t kLookedUpAtOnce = 256;      // known results per hold of the mutex

void ToProto(const PlannedTask& task, v1::PlannedTaskRecord* record) {
  record->set_kind(task.kind);
  record->set_title(task.name);
  record->set_tile(task.tile);
  record->set_parameters_json(task.parameters);
  record->set_cost(task.cost);
  record->set_scale(task.scale);
  record->set_later_cost(task.later_cost);
  record->set_later_bytes(task.later_bytes);
  record->set_peak_bytes(task.peak_bytes);
  record->set_stored_bytes(task.stored_bytes);
  record->mutable_scene_files()->Add(task.scene_files->begin(), task.scene_files->end());
  for (const PlannedTask::ViewFile& file : *task.view_files) {
    v1::ViewFileRecord& added = *record->add_view_files();
    added.set_file(file.file);
    added.set_view(file.view);
    added.set_likelihoods(file.likelihoods);
    added.set_mask(file.mask);
  }
  for (const PlannedInput& input : task.inputs) {
    v1::PlannedInputRecord& added = *record->add_inputs();
    added.set_task(input.task.value());
    added.set_output(input.output);
    if (input.tile >= 0) added.set_tile(input.tile);
  }
  AddFiles(*task.given, record->mutable_given());
}

// Stores the files that the planner made for tasks, and adds them to PlannedTask::given.
Status StoreGivenContents(BlobStore& blobs, std::vector<PlannedTask>& tasks) {
  std::vector<std::pair<PlannedTask*, const std::pair<std::string, std::string>*>> files;
  for (PlannedTask& task : tasks) {
    for (const auto& file : *task.given_contents) files.emplace_back(&task, &file);
  }
  std::vector<StatusOr<Digest>> stored(files.size(), Digest());
  ConcurrentForEach(static_cast<int64_t>(files.size()), BlobStore::kCallsAtOnce,
                    [&](int64_t i) { stored[i] = blobs.PutBytes(files[i].second->second); });
  for (size_t i = 0; i < files.size(); ++i) {
    TESSERA_RETURN_IF_ERROR(stored[i].status());
    files[i].first->given.Edit().push_back({files[i].second->first, *stored[i]});
  }
  return absl::OkStatus();
}

}  // namespace

Status PlanningLoop::Advance() {
  advance_wanted_ = true;
  while (advance_wanted_) {
    // The thread inside sees advance_wanted_ and continues.
    const std::unique_lock one_at_a_time(advance_mutex_, std::try_to_lock);
    if (!one_at_a_time) return absl::OkStatus();
    advance_wanted_ = false;
    while (true) {
      ReuseReady();
      std::optional<PendingStep> step;
      {
        std::lock_guard lock(mutex_);
        step = NextStep(ledger_);
      }
      if (!step) break;
      TESSERA_RETURN_IF_ERROR(step->kind == PendingStep::Kind::kEnd          ? EndJob(*step)
                              : step->kind == PendingStep::Kind::kQuarantine ? QuarantineTile(*step)
                                                                             : PlanJob(*step));
    }
    AdmitHeld();
  }
  return absl::OkStatus();
}

void PlanningLoop::AdvanceSoon() {
  if (advance_soon_.exchange(true)) return;
  advance_thread_.Do([this] {
    advance_soon_ = false;
    const Status status = Advance();
    std::lock_guard lock(mutex_);
    background_status_ = status;
  });
}

Status PlanningLoop::background_status() const {
  std::lock_guard lock(mutex_);
  return background_status_;
}

// Plans without the mutex, so the job may end or lose a tile meanwhile; such a plan is dropped at the next record. A
// large plan is several records, because applying one holds the mutex.
Status PlanningLoop::PlanJob(const PendingStep& step) {
  StatusOr<std::vector<PlannedTask>> tasks = PlanPhase(environment_, step);
  if (!tasks.ok()) {
    const StatusOr<bool> waits = recovery_.RemakeForPlan(step);
    if (waits.ok() && *waits) return absl::OkStatus();
    const bool for_good = absl::IsFailedPrecondition(waits.status()) || absl::IsNotFound(waits.status());
    if (!waits.ok() && !for_good) return waits.status();  // Tick retries and reports the error
    if (!waits.ok()) tasks = waits.status();
  }
  if (tasks.ok() && tasks->empty()) tasks = absl::InternalError("the plan has no tasks");
  const std::shared_lock refers(core_.blob_use().mutex);
  if (tasks.ok()) TESSERA_RETURN_IF_ERROR(StoreGivenContents(*environment_.blobs, *tasks));
  Status fault = tasks.status();
  std::vector<int> superseded;
  if (fault.ok() && step.replaces_from >= 0) {
    PlanChange change = ChangePlan(step.replaces_from, TasksFrom(core_, step), *std::move(tasks));
    tasks = std::move(change.added);
    superseded = std::move(change.superseded);
  }
  int first_task = step.tasks;
  // At least one record, also if a plan equals the one that it replaces.
  for (size_t next = 0; fault.ok() && (next == 0 || next < tasks->size());) {
    v1::Record record;
    v1::TasksPlanned& planned = *record.mutable_tasks_planned();
    planned.set_job(JobName(step.job));
    planned.set_first_task(first_task);
    for (size_t bytes = 0; next < tasks->size() && bytes < kMaxPlanBytes; ++next) {
      const PlannedTask task = std::move((*tasks)[next]);  // frees the memory of the plan step by step
      ToProto(task, planned.add_tasks());
      bytes += planned.tasks(planned.tasks_size() - 1).ByteSizeLong();
    }
    planned.set_more(next < tasks->size());
    // Planning is faster than storing: limit the records in memory.
    journal_.Wait(journal_.last() - kRecordsAhead).IgnoreError();
    if (!planned.more()) planned.mutable_superseded()->Add(superseded.begin(), superseded.end());
    std::lock_guard lock(mutex_);
    const Job& job = ledger_.jobs()[step.job];
    const int at = first_task == step.tasks && job.open_plan >= 0 ? job.open_plan : static_cast<int>(job.tasks.size());
    if (HasEnded(job.header.state) || at != first_task || QuarantinedTiles(job) != step.quarantined)
      return absl::OkStatus();
    first_task += planned.tasks_size();
    fault = core_.Commit(record);
    if (!fault.ok() || planned.more()) continue;
    next = tasks->size() + 1;  // ends the loop, if the plan was empty too
    for (const int task : superseded) leases_.Release({step.job, task});  // workers stop at their next heartbeat
  }
  if (fault.ok()) return absl::OkStatus();
  std::lock_guard lock(mutex_);
  const Job& job = ledger_.jobs()[step.job];
  if (HasEnded(job.header.state)) return absl::OkStatus();
  std::string error = "cannot plan the job: " + std::string(fault.message());
  for (const QuarantinedTile& tile : job.quarantined) error += "\n" + QuarantineText(job, tile);
  // The survey's plan depends on the scene and the settings; that of steps and of a fine part on results of workers.
  const bool of_workers = step.kind == PendingStep::Kind::kPlanSteps || step.split >= 0;
  const bool bad_input = absl::IsInvalidArgument(fault) && !of_workers;
  return CommitEnd(core_, step.job, JobState::kFailed, error, {}, 0, bad_input);
}

Status PlanningLoop::EndJob(PendingStep step) {
  step.end_us = environment_.clock->UnixTimeUs();
  const std::shared_lock refers(core_.blob_use().mutex);
  std::vector<NamedDigest> artifacts = step.artifacts;
  TESSERA_ASSIGN_OR_RETURN(const Digest report, StoreReport(core_, step));
  artifacts.push_back({kJobFile, report});
  std::lock_guard lock(mutex_);
  if (HasEnded(ledger_.jobs()[step.job].header.state)) return absl::OkStatus();
  return CommitEnd(core_, step.job, step.end, step.error, artifacts, step.end_us);
}

Status PlanningLoop::QuarantineTile(const PendingStep& step) {
  std::lock_guard lock(mutex_);
  const Job& job = ledger_.jobs()[step.job];
  if (HasEnded(job.header.state) || job.failed != step.failed) return absl::OkStatus();
  v1::Record record;
  v1::TileQuarantined& change = *record.mutable_tile_quarantined();
  change.set_job(job.header.name);
  change.set_tile(job.tasks[step.failed].plan.tile);
  change.set_task(step.failed);
  return core_.Commit(record);
}

void PlanningLoop::ReuseReady() {
  // A reuse may make readers ready, so repeat until no known result is left.
  do {
    std::vector<TaskRef> ready;
    {
      std::lock_guard lock(mutex_);
      ready = ledger_.TakeNewlyReady();
    }
    for (size_t next = 0; next < ready.size();) {
      std::lock_guard lock(mutex_);
      for (const size_t end = std::min(next + kLookedUpAtOnce, ready.size()); next < end; ++next) {
        if (MayReuse(ledger_, ready[next])) SetAside(core_, ready[next]);
      }
    }
  } while (ReuseResults(core_));
}

}  // namespace tessera
