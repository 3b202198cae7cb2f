// Jobs with permanently failed tasks: quarantine of tiles, and retries by a user.
#include <algorithm>
#include <utility>

#include "server/ledger/ledger.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

int Ledger::FirstFailed(const Job& job) {
  const auto found = std::find_if(job.tasks.begin(), job.tasks.end(), [](const JobTask& task) {
    return task.state == TaskState::kFailed && !task.superseded;
  });
  return found == job.tasks.end() ? -1 : static_cast<int>(found - job.tasks.begin());
}

void Ledger::Supersede(TaskRef ref) {
  Job& job = jobs_[ref.job];
  JobTask& task = job.tasks[ref.task];
  task.superseded = true;
  if (std::exchange(task.remaking, false)) --job.lost;
  if (task.state == TaskState::kSucceeded) return;
  --job.unfinished;
  if (task.state == TaskState::kFailed) return;
  ready_.Remove(ref, task);
  if (task.state == TaskState::kLeased) {
    task.attempts.back().end_us = ready_.now_us();
    task.attempts.back().cancelled = true;
  }
  task.state = TaskState::kCancelled;
}

void Ledger::Recount(Job& job) {
  job.totals = JobTotals();
  for (const QuarantinedTile& each : job.quarantined) job.totals.AddQuarantined(each.tile);
  for (int i = 0; i < static_cast<int>(job.tasks.size()); ++i) {
    const JobTask& task = job.tasks[i];
    if (task.superseded) continue;
    job.totals.AddPlanned(task);
    if (task.state == TaskState::kSucceeded && task.plan.given->empty()) job.totals.AddSucceeded(i, task);
  }
}

Status Ledger::CheckQuarantined(const v1::TileQuarantined& change) const {
  TESSERA_ASSIGN_OR_RETURN(const int index, FindJob(change.job()));
  const Job& job = jobs_[index];
  if (HasEnded(job.header.state)) return absl::FailedPreconditionError(change.job() + " has ended");
  if (change.task() < 0 || change.task() >= static_cast<int>(job.tasks.size())) {
    return absl::NotFoundError(change.job() + " has no task " + std::to_string(change.task()));
  }
  const JobTask& task = job.tasks[change.task()];
  if (task.state != TaskState::kFailed || task.superseded || change.tile() < 0 || task.plan.tile != change.tile()) {
    return absl::FailedPreconditionError(change.job() + ": '" + task.plan.name + "' has not failed for tile " +
                                         std::to_string(change.tile()));
  }
  return absl::OkStatus();
}

void Ledger::ApplyQuarantined(const v1::TileQuarantined& change) {
  const int index = *FindJob(change.job());
  Job& job = jobs_[index];
  Supersede({index, change.task()});
  // The tile may be quarantined already: until the job is planned without it, another task of it can fail.
  const auto place = std::lower_bound(job.quarantined.begin(), job.quarantined.end(), change.tile(),
                                      [](const QuarantinedTile& each, int tile) { return each.tile < tile; });
  if (place == job.quarantined.end() || place->tile != change.tile()) {
    job.quarantined.insert(place, {change.tile(), change.task()});
  }
  job.plans_anew = job.planned_to_end;
  job.failed = FirstFailed(job);
  Recount(job);
  if (job.failed < 0) {  // else the job fails because of another task
    ready_.SetJob(index, job.header.priority, job.header.paused);
    for (int i = 0; i < static_cast<int>(job.tasks.size()); ++i) {
      if (job.tasks[i].state == TaskState::kReady) ready_.Add({index, i}, job.tasks[i]);
    }
  }
  UpdateDue(index);
}

Status Ledger::CheckRetried(const v1::JobRetried& change) const {
  TESSERA_ASSIGN_OR_RETURN(const int index, FindJob(change.job()));
  const Job& job = jobs_[index];
  if (job.header.state != JobState::kFailed && job.header.state != JobState::kPartial) {
    return absl::FailedPreconditionError(change.job() + " has not failed: nothing to retry");
  }
  if (!change.has_tile()) return absl::OkStatus();
  bool found = std::any_of(job.quarantined.begin(), job.quarantined.end(),
                           [&](const QuarantinedTile& each) { return each.tile == change.tile(); });
  for (const JobTask& task : job.tasks) {
    if (task.state != TaskState::kFailed || task.superseded) continue;
    if (task.plan.tile != change.tile()) {
      return absl::FailedPreconditionError(change.job() + ": '" + task.plan.name +
                                           "' has failed too and is not of tile " + std::to_string(change.tile()) +
                                           "; retry the whole job");
    }
    found = true;
  }
  if (found) return absl::OkStatus();
  return absl::FailedPreconditionError(change.job() + ": no task of tile " + std::to_string(change.tile()) +
                                       " has failed");
}

// Failed and cancelled tasks wait again with their attempts forgiven; succeeded ones stay. Jobs with quarantined tiles
// are planned again, because the old plan lacks these tiles.
void Ledger::ApplyRetried(const v1::JobRetried& change) {
  const int index = *FindJob(change.job());
  Job& job = jobs_[index];
  JobHeader& header = job.header;
  header.state = header.start_us > 0 ? JobState::kRunning : JobState::kQueued;
  header.error.clear();
  header.end_us = 0;
  active_jobs_.insert(std::lower_bound(active_jobs_.begin(), active_jobs_.end(), index), index);
  CountActive(header.client, 1);
  ready_.SetJob(index, header.priority, header.paused);
  for (const QuarantinedTile& each : std::exchange(job.quarantined, {})) {
    if (change.has_tile() && each.tile != change.tile()) {
      job.quarantined.push_back(each);
      continue;
    }
    job.plans_anew = job.planned_to_end;
    JobTask& failed = job.tasks[each.task];
    if (failed.plan.kind != kCutKind) continue;  // the new plan has a new task for it
    failed.superseded = false;
    ++job.unfinished;
  }
  // Given tasks succeed again; if an output is still lost, its next reader reports it.
  for (JobTask& given : job.tasks) {
    if (given.plan.given->empty() || given.state == TaskState::kSucceeded) continue;
    given.state = TaskState::kSucceeded;
    given.error.Clear();
    given.missing = 0;
    --job.unfinished;
    if (std::exchange(given.remaking, false)) --job.lost;
    for (const int reader : given.readers) --job.tasks[reader].missing;
  }
  job.lost_error.clear();
  job.lost = static_cast<int>(
      std::count_if(job.tasks.begin(), job.tasks.end(), [](const JobTask& task) { return task.remaking; }));
  for (JobTask& task : job.tasks) {
    task.remakes = 0;
    for (Attempt& attempt : task.attempts) attempt.after_end = false;  // the next report covers all attempts
    if (task.superseded || (task.state != TaskState::kFailed && task.state != TaskState::kCancelled)) continue;
    task.state = TaskState::kWaiting;
    task.forgiven = task.attempt();
    task.retry_delay_us = 0;
    task.error.Clear();
    task.end_us = 0;
  }
  job.failed = -1;
  Recount(job);
  for (int task = 0; task < static_cast<int>(job.tasks.size()); ++task) {
    if (!job.tasks[task].superseded) ReadyTask({index, task});
  }
  UpdateDue(index);
}

}  // namespace tessera
