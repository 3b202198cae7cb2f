#include "server/dispatch/job_status.h"

#include <algorithm>
#include <set>

namespace tessera {
namespace {

// Shares of the progress bar that reading the scene and cutting it get: before either has ended, the rest of the work
// is not known.
constexpr double kIngestShare = 0.02, kCutShare = 0.03;

// Cost of some tasks, and of what of it is done.
struct Part {
  double total = 0, done = 0;
  void Add(double cost, double fraction) {
    total += cost;
    done += cost * fraction;
  }
  double share() const { return total > 0 ? done / total : 0; }
};

}  // namespace

JobStatus StatusOfJob(const Job& job, int job_index, const LeaseTable& leases, int64_t now_us) {
  JobStatus status;
  status.header = job.header;
  std::set<int> tiles, unfinished_tiles;
  Part ingest, cut, rest;
  double timed_cost = 0, timed_s = 0;  // where cost meets seconds
  int running = 0;
  for (size_t i = 0; i < job.tasks.size(); ++i) {
    const JobTask& task = job.tasks[i];
    const std::string& kind = task.plan.kind;
    const bool is_ingest = kind == kIngestKind || kind == kUpdateKind;
    if (!task.plan.given.empty()) continue;  // nothing to do
    ++status.tasks_total;
    double fraction = 0;
    if (task.state == TaskState::kSucceeded) {
      ++status.tasks_done;
      fraction = 1;
      if (!task.reused && !is_ingest) {
        timed_cost += task.plan.cost;
        timed_s += static_cast<double>(task.end_us - task.attempts.back().start_us) / 1e6;
      }
      status.header.warnings.insert(status.header.warnings.end(), task.warnings.begin(), task.warnings.end());
    } else if (const LeaseState* lease = leases.Find({job_index, static_cast<int>(i)})) {
      ++running;
      fraction = lease->progress;
      if (!is_ingest) {
        timed_cost += task.plan.cost * fraction;
        timed_s += static_cast<double>(now_us - lease->start_us) / 1e6;
      }
    }
    Part& part = is_ingest ? ingest : kind == kCutKind ? cut : rest;
    part.Add(task.plan.cost, fraction);
    if (task.plan.tile >= 0) {
      tiles.insert(task.plan.tile);
      if (task.state != TaskState::kSucceeded || !job.planned_to_end) unfinished_tiles.insert(task.plan.tile);
    }
  }
  status.tiles_total = static_cast<int>(tiles.size());
  status.tiles_done = static_cast<int>(tiles.size() - unfinished_tiles.size());
  const double cut_share = cut.total > 0 ? kCutShare : 0;
  status.progress =
      kIngestShare * ingest.share() + cut_share * cut.share() + (1 - kIngestShare - cut_share) * rest.share();
  if (job.header.state == JobState::kSucceeded) status.progress = 1;
  if (HasEnded(job.header.state)) {
    status.eta_s = 0;
  } else if (rest.total > 0 && timed_cost > 0) {
    status.eta_s = (cut.total - cut.done + rest.total - rest.done) * timed_s / timed_cost / std::max(1, running);
  }
  return status;
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
