#include "server/jobs/job_status.h"

#include <algorithm>
#include <optional>
#include <tuple>

#include "absl/strings/str_cat.h"
#include "common/job/task_parameters.h"
#include "server/jobs/tile_quarantine.h"
#include "server/tiling/cost_model.h"

namespace tessera {
namespace {

// Shares of the progress for reading and cutting the scene. The other costs are unknown until each has ended.
constexpr double kIngestShare = 0.02, kCutShare = 0.03;

// The leased task of the first stage, else the ready task that is leased next.
std::optional<TaskRef> FrontTask(const Ledger& ledger, int job, const LeaseTable& leases) {
  const std::vector<TaskRef> running = leases.OfJob(job);
  const auto first = std::min_element(running.begin(), running.end(), [&](TaskRef a, TaskRef b) {
    return std::tuple(ledger.task(a).depth, a.task) < std::tuple(ledger.task(b).depth, b.task);
  });
  return first != running.end() ? *first : ledger.ready().FirstOfJob(job);
}

const char* UnitOf(const PlannedTask& plan) {
  if (plan.tile >= 0) return "tiles";
  return plan.kind == kClassifyKind ? "images" : "parts";
}

}  // namespace

AttemptOutcome OutcomeOf(const Attempt& attempt) {
  if (attempt.lease_expired) return AttemptOutcome::kLeaseExpired;
  if (attempt.failure->error_class != ErrorClass::kNone) return AttemptOutcome::kFailed;
  if (attempt.cancelled) return AttemptOutcome::kCancelled;
  return attempt.end_us > 0 ? AttemptOutcome::kSucceeded : AttemptOutcome::kRunning;
}

std::string StageText(const Ledger& ledger, int index, const LeaseTable& leases) {
  const Job& job = ledger.jobs()[index];
  if (HasEnded(job.header.state)) return "";
  const std::optional<TaskRef> front = FrontTask(ledger, index, leases);
  if (!front) return "";
  const JobTask& task = ledger.task(*front);
  std::string text(KindOf(task.plan.kind.str()).doing);
  if (text.empty()) text = task.plan.name;
  if (const auto step = ParseStepParameters(task.plan.parameters); step.ok()) {
    const size_t steps = StepsOf(job.header.settings).size();
    if (task.plan.kind == kMendKind) text += step->before ? " before" : " after";
    absl::StrAppend(&text, " step ", step->step, " of ", std::max<size_t>(steps, 1) - 1);
  }
  const StageCount count = job.totals.StageOf(task);
  if (count.planned > 1) return absl::StrCat(text, ", ", count.done, " of ", count.planned, " ", UnitOf(task.plan));
  const LeaseState* const lease = leases.Find(*front);
  return lease != nullptr && !lease->stage.empty() ? absl::StrCat(text, ": ", lease->stage) : text;
}

JobStatus StatusOfJob(const Job& job, int job_index, const LeaseTable& leases, int64_t now_us,
                      size_t max_artifacts) {
  JobStatus status;
  status.header = job.header;
  status.artifacts_total = static_cast<int>(job.artifacts.size());
  status.artifacts.assign(
      job.artifacts.begin(),
      job.artifacts.begin() + static_cast<std::ptrdiff_t>(std::min(job.artifacts.size(), max_artifacts)));
  for (const int index : job.totals.warned()) {
    for (const std::string& warning : *job.tasks[index].warnings) {  // ingest repeats those of the submission
      const Warnings& known = job.header.warnings;
      if (std::find(known.begin(), known.end(), warning) == known.end()) status.header.warnings.push_back(warning);
    }
  }
  for (const QuarantinedTile& tile : job.quarantined) status.header.warnings.push_back(QuarantineText(job, tile));
  JobSums sums = job.totals.sums();
  const std::vector<TaskRef> running = leases.OfJob(job_index);
  for (const TaskRef ref : running) {
    const PlannedTask& plan = job.tasks[ref.task].plan;
    const LeaseState& lease = *leases.Find(ref);
    sums.PartOf(plan.kind).done += plan.cost * lease.progress;
    sums.AddRun(plan, plan.cost * lease.progress, static_cast<double>(now_us - lease.start_us) / 1e6);
  }
  status.tasks_total = sums.tasks;
  status.tasks_done = sums.tasks_done;
  status.tiles_total = sums.tiles;
  status.tiles_done = job.planned_to_end ? sums.tiles - sums.unfinished_tiles : 0;
  status.core_seconds = sums.core_seconds;
  if (!job.planned_to_end) sums.rest.total += sums.later;
  status.predicted_core_seconds = sums.ingest.total + sums.cut.total + sums.rest.total;
  const auto& [ingest, cut, rest] = std::tie(sums.ingest, sums.cut, sums.rest);
  const double cut_share = cut.total > 0 ? kCutShare : 0;
  status.progress =
      kIngestShare * ingest.share() + cut_share * cut.share() + (1 - kIngestShare - cut_share) * rest.share();
  if (job.header.state == JobState::kSucceeded || job.header.state == JobState::kPartial) status.progress = 1;
  if (HasEnded(job.header.state)) {
    status.eta_s = status.eta_low_s = status.eta_high_s = 0;
  } else if (rest.total > 0 && sums.timed_cost > 0) {
    status.eta_s = (cut.total - cut.done + rest.total - rest.done) * sums.timed_s / sums.timed_cost /
                   static_cast<double>(std::max(size_t{1}, running.size()));
    status.eta_low_s = status.eta_s * kRefineSecondsInterval.low;
    status.eta_high_s = status.eta_s * kRefineSecondsInterval.high;
  }
  return status;
}

void TakeEndFrom(JobStatus& status) {
  if (!HasEnded(status.header.state)) return;
  status.header.state = status.header.start_us > 0 ? JobState::kRunning : JobState::kQueued;
  status.header.end_us = 0;
  status.header.error.clear();
  status.header.bad_input = false;
  status.artifacts.clear();
  status.artifacts_total = 0;
  status.waiting_for = "the end of the job is not stored yet";
}

TaskStatus StatusOfTask(const Job& job, TaskRef ref, const LeaseTable& leases) {
  TaskStatus status;
  status.name = TaskName(ref);
  status.task = job.tasks[ref.task];
  if (const LeaseState* lease = leases.Find(ref)) {
    status.progress = lease->progress;
    status.stage = lease->stage;
  } else if (status.task.state == TaskState::kSucceeded) {
    status.progress = 1;
  }
  return status;
}

}  // namespace tessera
