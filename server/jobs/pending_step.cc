#include "server/jobs/pending_step.h"

#include <algorithm>
#include <functional>
#include <mutex>
#include <string_view>

#include "common/base/parallel.h"
#include "common/job/task_parameters.h"
#include "server/jobs/job_report.h"
#include "server/jobs/planner.h"
#include "server/ledger/base_of.h"
#include "server/ledger/task_inputs.h"
#include "server/plan/crop_tasks.h"

namespace tessera {
namespace {

constexpr int kReportedAtOnce = 256;                  // tasks per hold of the mutex
constexpr int64_t kMaxReadsBytes = int64_t{1} << 20;  // of a tile's kReadsFile

// Whether an output of a task that makes artifacts is a result; others are inputs of later tasks.
bool IsResult(std::string_view kind, const std::string& output) {
  return kind == kExportKind ? output.starts_with(kExportFolder) : output != kOutdatedFile;
}

}  // namespace

// Derives the step from the state alone, so a restart continues where the records end. The order is: failures, lost
// inputs, unfinished or outdated plans, then the end of the job.
std::optional<PendingStep> NextStep(const Ledger& ledger) {
  if (ledger.due_jobs().empty()) return std::nullopt;
  const int index = *ledger.due_jobs().begin();
  const Job& job = ledger.jobs()[index];
  PendingStep step;
  step.job = index;
  if (job.failed >= 0) {
    const JobTask& task = job.tasks[job.failed];
    if (CanContinueWithout(job)) {
      step.kind = PendingStep::Kind::kQuarantine;
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
  } else if (job.open_plan >= 0 || !job.planned_to_end || (job.replan_from >= 0 && CutsAreDone(job))) {
    step.quarantined = QuarantinedTiles(job);
    step.replaces_from = job.replan_from;
    step.settings = job.header.settings;
    step.scene_files = job.scene_files;
    step.tasks = job.open_plan >= 0 ? job.open_plan : static_cast<int>(job.tasks.size());
    const std::string& base = step.settings.update.base;
    if (!base.empty()) step.base = BaseOf(ledger, step.settings.update);
    for (int task = 0; task < (job.replan_from >= 0 ? job.replan_from : step.tasks); ++task) {
      const TaskPhase phase = KindOf(job.tasks[task].plan.kind.str()).phase;
      if (step.split < 0 && !job.tasks[task].superseded) {
        step.coarse_crops.merge(CropsByTile(job.tasks[task].plan, TaskId(task)));
      }
      if (job.tasks[task].plan.kind == kSplitKind && !job.tasks[task].superseded) {
        step.split = task;
        step.first_fine_cut = -1;
        step.fine_survey = InputDigest(job, {TaskId(task), kSurveyFile});
        step.reads.clear();
        step.kind = PendingStep::Kind::kPlanTiles;
      } else if (job.tasks[task].plan.kind == kInspectKind) {
        ++step.inspections;
      } else if (phase == TaskPhase::kSurvey) {
        step.survey = InputDigest(job, {TaskId(task), kSurveyFile});
        step.kind = PendingStep::Kind::kPlanTiles;
      } else if (phase == TaskPhase::kCut) {
        step.tiles = std::max(step.tiles, job.tasks[task].plan.tile + 1);
        step.kind = PendingStep::Kind::kPlanSteps;
        if (step.split >= 0 && step.first_fine_cut < 0) step.first_fine_cut = task;
        if (job.tasks[task].superseded) continue;
        step.reads.emplace_back(job.tasks[task].plan.tile, InputDigest(job, {TaskId(task), kReadsFile}));
      }
    }
    if (step.tasks == 0) step.kind = base.empty() ? PendingStep::Kind::kPlanIngest : PendingStep::Kind::kPlanUpdate;
    return step;
  } else {
    for (const JobTask& task : job.tasks) {
      if (task.superseded || !KindOf(task.plan.kind.str()).makes_artifacts) continue;
      for (const StoredFile& file : task.outputs) {
        if (IsResult(task.plan.kind.str(), file.name.str())) step.artifacts.push_back(file);
      }
    }
    step.end = job.quarantined.empty() ? JobState::kSucceeded : JobState::kPartial;
    for (const QuarantinedTile& tile : job.quarantined) {
      step.error += (step.error.empty() ? "" : "\n") + QuarantineText(job, tile);
    }
  }
  for (const QuarantinedTile& tile : job.quarantined) step.why_quarantined[tile.tile] = QuarantineText(job, tile);
  step.header = job.header;
  step.tasks = static_cast<int>(job.tasks.size());
  return step;
}

StatusOr<std::vector<PlannedTask>> PlanPhase(const DispatchEnvironment& environment, const PendingStep& step) {
  Planner& planner = *environment.planner;
  std::vector<std::string> names;
  std::vector<int64_t> size_bytes;
  for (const NamedDigest& file : step.scene_files) {
    names.push_back(file.name);
    size_bytes.push_back(file.digest.size_bytes);
  }
  if (step.kind == PendingStep::Kind::kPlanIngest) return planner.Ingest(step.settings, names, size_bytes);
  std::optional<UpdateBase> base;
  if (step.base) {
    TESSERA_RETURN_IF_ERROR(step.base->status());
    base = **step.base;
    TESSERA_ASSIGN_OR_RETURN(base->survey_json, environment.blobs->Read(base->survey));
    base->inspections = step.inspections;
  }
  if (step.kind == PendingStep::Kind::kPlanUpdate) return planner.Update(step.settings, step.scene_files, *base);
  TESSERA_RETURN_IF_ERROR(step.survey.status());
  TESSERA_ASSIGN_OR_RETURN(const std::string survey, environment.blobs->Read(*step.survey));
  const UpdateBase* const goes_on_from = base ? &*base : nullptr;
  std::optional<FinePart> fine;
  if (step.split >= 0) {
    TESSERA_RETURN_IF_ERROR(step.fine_survey.status());
    const bool cuts_again = step.kind == PendingStep::Kind::kPlanTiles;
    fine = FinePart{"", TaskId(step.split), cuts_again ? step.tasks : step.first_fine_cut, {}, step.coarse_crops};
    TESSERA_ASSIGN_OR_RETURN(fine->survey, environment.blobs->Read(*step.fine_survey));
    for (const FailedTile& tile : step.quarantined) {
      if (!tile.fine) fine->left_out.push_back(tile.tile);
    }
  }
  const FinePart* const fine_part = fine ? &*fine : nullptr;
  if (step.kind == PendingStep::Kind::kPlanTiles) {
    return planner.Tiles(step.settings, survey, names, goes_on_from, fine_part);
  }
  std::vector<TileReads> reads;
  // An update has its base's tiles and may cut new ones after them.
  const int tiles = std::max(step.tiles, static_cast<int>(base ? base->tiles.size() : 0));
  const auto read = [&](int tile, const StatusOr<Digest>& digest) -> StatusOr<TileReads> {
    TESSERA_RETURN_IF_ERROR(digest.status());
    TESSERA_ASSIGN_OR_RETURN(const std::string json, environment.blobs->Read(*digest, kMaxReadsBytes));
    return ParseTileReads(json, tile, tiles);
  };
  std::vector<StatusOr<TileReads>> of_tiles(step.reads.size());
  ConcurrentForEach(static_cast<int64_t>(of_tiles.size()), BlobStore::kCallsAtOnce,
                    [&](int64_t i) { of_tiles[i] = read(step.reads[i].first, step.reads[i].second); });
  for (size_t i = 0; i < of_tiles.size(); ++i) {
    if (const Status status = of_tiles[i].status(); !status.ok()) {
      return Status(status.code(),
                    "tile " + std::to_string(step.reads[i].first) + ": " + std::string(status.message()));
    }
    reads.push_back(*std::move(of_tiles[i]));
  }
  return planner.Steps(step.settings, survey, names, reads, goes_on_from, step.quarantined, fine_part);
}

// Copies a few tasks per hold of the mutex.
std::vector<KnownTask> TasksFrom(DispatchCore& core, const PendingStep& step) {
  std::vector<KnownTask> known;
  for (int first = step.replaces_from; first < step.tasks; first += kReportedAtOnce) {
    std::lock_guard lock(core.mutex());
    const std::deque<JobTask>& all = core.ledger().jobs()[step.job].tasks;
    const int end = std::min({first + kReportedAtOnce, step.tasks, static_cast<int>(all.size())});
    for (int i = first; i < end; ++i) known.push_back({all[i].plan, all[i].superseded});
  }
  return known;
}

StatusOr<Digest> StoreReport(DispatchCore& core, const PendingStep& step) {
  const auto visit = [&](const std::function<void(const JobTask&)>& visitor) {
    for (int first = 0; first < step.tasks; first += kReportedAtOnce) {
      std::vector<JobTask> tasks;
      {
        std::lock_guard lock(core.mutex());
        const std::deque<JobTask>& all = core.ledger().jobs()[step.job].tasks;
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
  JobReport report(step.header, step.end, step.error, step.why_quarantined, step.end_us);
  visit([&](const JobTask& task) { report.Count(task); });
  return core.environment().blobs->PutParts([&](const BlobStore::Writer& write) {
    write(report.Head());
    visit([&](const JobTask& task) { write(report.Line(task)); });
    write(JobReport::Tail());
  });
}

}  // namespace tessera
