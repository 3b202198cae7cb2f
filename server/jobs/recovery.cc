#include "server/jobs/recovery.h"

#include <algorithm>
#include <shared_mutex>
#include <utility>

#include "common/base/parallel.h"
#include "server/leases/attempts.h"
#include "server/ledger/base_of.h"
#include "server/ledger/task_inputs.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

std::string MessageOf(const Status& status) { return std::string(status.message()); }

// Whether VerifyOrQuarantine found the blob missing or damaged.
bool IsLost(const Status& status) { return absl::IsNotFound(status) || absl::IsDataLoss(status); }

}  // namespace

struct Recovery::Lost {
  Digest digest;
  std::string name;                // of the input or scene file
  TaskRef producer = {};           // task -1: scene file
  int remakes = 0;                 // JobTask::remakes of the producer before hashing
  std::vector<std::string> paths;  // possible paths of a scene file
};

std::vector<Recovery::Lost> Recovery::LostInputsLocked(TaskRef ref, const std::set<std::string>& sha256) const {
  const Job& job = ledger_.jobs()[ref.job];
  const PlannedTask& plan = ledger_.task(ref).plan;
  std::vector<Lost> lost;
  for (const PlannedInput& input : plan.inputs) {
    const auto digest = InputDigest(job, input);
    if (!digest.ok() || !sha256.contains(digest->sha256)) continue;
    const TaskRef producer = {ref.job, input.task.value()};
    lost.push_back({*digest, InputName(input), producer, ledger_.task(producer).remakes, {}});
  }
  std::vector<int> files = *plan.scene_files;
  for (const PlannedTask::ViewFile& file : *plan.view_files) files.push_back(file.file);
  for (const int index : files) {
    const NamedDigest& file = job.scene_files[index];
    if (!sha256.contains(file.digest.sha256)) continue;
    Lost& added = lost.emplace_back(Lost{file.digest, file.name, {}, 0, ledger_.scene_files().PathsOf(file.digest)});
    if (LiesInScene(file.name)) added.paths.insert(added.paths.begin(), job.header.scene_path + "/" + file.name);
    if (file.name == kClassifierFile) added.paths.clear();  // stored as a blob
  }
  return lost;
}

Status Recovery::Examine(Lost& lost) const {
  if (lost.producer.task >= 0) return environment_.blobs->VerifyOrQuarantine(lost.digest);
  std::string faults;
  if (lost.name == kClassifierFile) {
    const Status stored = environment_.blobs->Verify(lost.digest);
    if (stored.ok()) return stored;
    faults = MessageOf(stored);
  }
  for (const std::string& path : lost.paths) {
    const auto found = environment_.hash_scene_file(path);
    if (found.ok() && *found == lost.digest) return absl::OkStatus();
    if (absl::IsUnavailable(found.status())) return found.status();
    faults += (faults.empty() ? "" : "; ") +
              (found.ok() ? path + " was changed after the job was submitted" : MessageOf(found.status()));
  }
  return absl::InvalidArgumentError("scene file " + lost.name + " has changed: " + faults +
                                    "; restore it and submit again, or submit the scene as it is now");
}

// Hashes the inputs without the mutex, because they may be large, and then checks the attempt again. The coordinator's
// own finding decides: a worker's report alone never reruns a task.
Status Recovery::ReportLostInputs(const std::string& worker, const std::string& task, int attempt,
                                  TaskFailure failure) {
  const auto find = [&]() -> StatusOr<TaskRef> {
    MarkSeen(core_, worker).IgnoreError();
    TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindReported(core_, task));
    TESSERA_RETURN_IF_ERROR(CheckCurrent(core_, ref, worker, attempt));
    return ref;
  };
  std::set<std::string> reported;
  for (const Digest& digest : failure.lost_inputs) reported.insert(digest.sha256);
  std::vector<Lost> inputs;
  {
    std::lock_guard lock(mutex_);
    TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, find());
    inputs = LostInputsLocked(ref, reported);
  }
  std::vector<std::pair<const Lost*, std::string>> lost;
  Status fault;
  for (Lost& input : inputs) {
    Status status = Examine(input);
    if (IsLost(status) && RestorePlanned(input.producer.job, input.digest).ok()) status = absl::OkStatus();
    if (IsLost(status)) {
      lost.emplace_back(&input, "input " + input.name + ": " + MessageOf(status));
    } else if (fault.ok() || absl::IsInvalidArgument(status)) {
      fault = status;
    }
  }
  const std::shared_lock refers(core_.blob_use().mutex);
  std::lock_guard lock(mutex_);
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, find());
  if (absl::IsInvalidArgument(fault)) {  // confirmed here: no other worker needs to try
    return EndAttempt(core_, ref, {true, 0, {ErrorClass::kInput, MessageOf(fault)}}, false);
  }
  // Results that were reported lost by another attempt meanwhile may already be recomputed.
  const bool any_lost = !lost.empty();
  const std::string first_reason = any_lost ? lost.front().second : "";
  std::erase_if(lost,
                [&](const auto& each) { return ledger_.task(each.first->producer).remakes != each.first->remakes; });
  for (const auto& [input, reason] : lost) {
    const JobTask& producer = ledger_.task(input->producer);
    if (producer.plan.given->empty() && producer.state != TaskState::kSucceeded)
      continue;  // already runs again for another output
    TaskRef maker = input->producer, needed_by = {};
    Status made_again;
    if (!producer.plan.given->empty()) {
      const auto elsewhere = MakerOf(ledger_, ref.job, input->digest, false);
      made_again = elsewhere.status();
      if (elsewhere.ok()) maker = *elsewhere;
      needed_by = input->producer;
    }
    if (made_again.ok()) made_again = RemakeLocked(maker, reason, needed_by);
    if (absl::IsFailedPrecondition(made_again) || absl::IsNotFound(made_again)) {
      return EndAttempt(core_, ref, {true, 0, {ErrorClass::kStorage, reason + "; " + MessageOf(made_again)}}, false);
    }
    TESSERA_RETURN_IF_ERROR(made_again);
  }
  // Counts against storage. The task needs no delay, because it waits for its inputs.
  if (any_lost) return EndAttempt(core_, ref, {false, 0, {ErrorClass::kStorage, first_reason}}, false);
  if (!fault.ok()) failure = {ErrorClass::kStorage, failure.message + "; " + MessageOf(fault)};
  return FailAttempt(core_, ref, failure);  // the input is intact here, so this counts against the worker
}

Status Recovery::RemakeLocked(TaskRef maker, const std::string& reason, TaskRef needed_by) {
  const JobTask& made = ledger_.task(maker);
  if (!made.remaking && made.remakes >= options_.retry.max_remakes) {
    return absl::FailedPreconditionError("it was recomputed " + std::to_string(made.remakes) + " times by '" +
                                         made.plan.name + "' of " + ledger_.jobs()[maker.job].header.name +
                                         " and lost every time: check the disk of " + environment_.blobs->Location());
  }
  TESSERA_RETURN_IF_ERROR(ledger_.CheckVersion(maker.job, "it cannot be recomputed; submit its scene as a new job"));
  v1::Record record;
  v1::ResultLost& lost = *record.mutable_result_lost();
  lost.set_task(TaskName(maker));
  lost.set_reason(reason);
  if (needed_by.task >= 0) {
    lost.add_needed_by_tasks(TaskName(needed_by));
  } else if (needed_by.job >= 0) {
    lost.add_needed_by_jobs(JobName(needed_by.job));
  }
  return core_.Commit(record);
}

StatusOr<bool> Recovery::RemakeForPlan(const PendingStep& step) {
  std::vector<std::pair<Digest, bool>> reads;  // second: made by a task of this job
  for (const auto* survey : {&step.survey, &step.fine_survey}) {
    if (survey->ok()) reads.emplace_back(**survey, true);
  }
  for (const auto& [tile, digest] : step.reads) {
    if (digest.ok()) reads.emplace_back(*digest, true);
  }
  if (step.base && step.base->ok()) reads.emplace_back((**step.base).survey, false);
  std::vector<Status> found(reads.size());
  ConcurrentForEach(static_cast<int64_t>(reads.size()), BlobStore::kCallsAtOnce,
                    [&](int64_t i) { found[i] = environment_.blobs->VerifyOrQuarantine(reads[i].first); });
  bool waits = false;
  for (size_t i = 0; i < reads.size(); ++i) {
    const auto& [digest, own] = reads[i];
    const Status& status = found[i];
    if (status.ok()) continue;
    if (!IsLost(status)) return status;
    const std::shared_lock refers(core_.blob_use().mutex);
    std::lock_guard lock(mutex_);
    if (HasEnded(ledger_.jobs()[step.job].header.state)) return true;
    TESSERA_ASSIGN_OR_RETURN(const TaskRef maker, MakerOf(ledger_, step.job, digest, own));
    // A task of this job delays the plan by itself, because it no longer counts as succeeded.
    const TaskRef needed_by = maker.job == step.job ? TaskRef() : TaskRef{step.job, -1};
    if (!ledger_.task(maker).remaking || needed_by.job >= 0) {
      TESSERA_RETURN_IF_ERROR(
          RemakeLocked(maker, "the plan of " + JobName(step.job) + ": " + MessageOf(status), needed_by));
    }
    waits = true;
  }
  return waits;
}

StatusOr<std::string> Recovery::ReadSurveyOf(const UpdateBase& base) {
  auto survey = environment_.blobs->Read(base.survey);
  if (survey.ok()) return survey;
  const Status status = environment_.blobs->VerifyOrQuarantine(base.survey);
  if (!IsLost(status)) return survey.status();
  const std::shared_lock refers(core_.blob_use().mutex);
  std::lock_guard lock(mutex_);
  TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(base.name));
  TESSERA_ASSIGN_OR_RETURN(const TaskRef maker, MakerOf(ledger_, job, base.survey, true));
  if (!ledger_.task(maker).remaking) TESSERA_RETURN_IF_ERROR(RemakeLocked(maker, MessageOf(status), {}));
  return absl::UnavailableError(base.name + ": its lost survey is being recomputed by '" +
                                ledger_.task(maker).plan.name + "'; submit again when that task has succeeded");
}

Status Recovery::RemakeArtifact(const Digest& digest) {
  const auto published = [&digest](const Job& job) {
    return (job.header.state == JobState::kSucceeded || job.header.state == JobState::kPartial) &&
           std::any_of(job.artifacts.begin(), job.artifacts.end(),
                       [&](const NamedDigest& file) { return file.digest == digest; });
  };
  int job = -1;
  const auto find = [&] {
    const auto found = std::find_if(ledger_.jobs().rbegin(), ledger_.jobs().rend(), published);
    job = found == ledger_.jobs().rend() ? -1 : static_cast<int>(ledger_.jobs().rend() - found) - 1;
  };
  {
    std::lock_guard lock(mutex_);
    find();
  }
  if (job < 0) return absl::NotFoundError("no blob " + digest.sha256);
  const Status status = environment_.blobs->VerifyOrQuarantine(digest);
  if (!IsLost(status)) return status;
  if (RestorePlanned(job, digest).ok()) return absl::OkStatus();
  if (const Status report = RestoreReport(job, digest); !absl::IsNotFound(report)) return report;
  const std::shared_lock refers(core_.blob_use().mutex);
  std::lock_guard lock(mutex_);
  TESSERA_ASSIGN_OR_RETURN(const TaskRef maker, MakerOf(ledger_, job, digest, true));
  return ledger_.task(maker).remaking ? absl::OkStatus() : RemakeLocked(maker, MessageOf(status), {});
}

// Files in PlannedTask::given_contents have no task that could recompute them. The planner is deterministic, so
// planning the same phase again gives the same bytes.
Status Recovery::RestorePlanned(int index, const Digest& digest) {
  PendingStep step;
  {
    std::lock_guard lock(mutex_);
    const Job& job = ledger_.jobs()[index];
    const bool given = std::any_of(job.tasks.begin(), job.tasks.end(), [&](const JobTask& task) {
      return std::any_of(task.plan.given->begin(), task.plan.given->end(),
                         [&](const NamedDigest& output) { return output.digest == digest; });
    });
    if (!given || MakerOf(ledger_, index, digest, false).ok()) return absl::NotFoundError("not made by the planner");
    step.job = index;
    step.settings = job.header.settings;
    step.scene_files = job.scene_files;
    step.base = BaseOf(ledger_, step.settings.update);
    for (size_t task = 0; task < job.tasks.size(); ++task) {
      step.inspections += job.tasks[task].plan.kind == kInspectKind;
      if (KindOf(job.tasks[task].plan.kind.str()).phase != TaskPhase::kSurvey) continue;
      step.survey = InputDigest(job, {TaskId(static_cast<int>(task)), kSurveyFile});
    }
  }
  for (const auto kind : {PendingStep::Kind::kPlanUpdate, PendingStep::Kind::kPlanTiles}) {
    step.kind = kind;
    if (kind == PendingStep::Kind::kPlanTiles && !step.survey.ok()) continue;
    const auto tasks = PlanPhase(environment_, step);
    if (!tasks.ok()) continue;
    for (const PlannedTask& task : *tasks) {
      for (const auto& [name, content] : *task.given_contents) {
        if (Sha256Hex(content) == digest.sha256) return environment_.blobs->PutBytes(content).status();
      }
    }
  }
  return absl::NotFoundError("no file of the plan has this content");
}

Status Recovery::RestoreReport(int index, const Digest& digest) {
  PendingStep step;
  {
    std::lock_guard lock(mutex_);
    const Job& job = ledger_.jobs()[index];
    const NamedDigest report = {kJobFile, digest};
    const auto& artifacts = job.artifacts;
    if (std::find(artifacts.begin(), artifacts.end(), report) == artifacts.end()) {
      return absl::NotFoundError("not the report of " + job.header.name);
    }
    if (job.lost > 0)
      return absl::UnavailableError("results of " + job.header.name + " are being recomputed; try again later");
    step.job = index;
    step.header = job.header;
    step.end = job.header.state;
    step.end_us = job.header.end_us;
    step.error = job.header.error;
    step.tasks = static_cast<int>(job.tasks.size());
    for (const QuarantinedTile& tile : job.quarantined) step.why_quarantined[tile.tile] = QuarantineText(job, tile);
  }
  TESSERA_ASSIGN_OR_RETURN(const Digest again, StoreReport(core_, step));
  if (again == digest) return absl::OkStatus();
  return absl::FailedPreconditionError(std::string(kJobFile) + " of " + step.header.name +
                                       " is lost and cannot be reproduced: an earlier release wrote it");
}

}  // namespace tessera
