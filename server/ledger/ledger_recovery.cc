// Changes after faults and by users: quarantine, retry, lost results, deletion and restart.
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
    job.totals.AddPlanned(i, task);
    if (task.state == TaskState::kSucceeded && task.plan.given->empty()) job.totals.AddSucceeded(i, task);
  }
  for (int i = 0; i < static_cast<int>(job.tasks.size()); ++i) {
    const JobTask& task = job.tasks[i];
    const auto failed = std::count_if(task.attempts.begin(), task.attempts.end(), [](const Attempt& attempt) {
      return attempt.lease_expired || attempt.failure->error_class != ErrorClass::kNone;
    });
    if (task.attempt() == 0) continue;
    job.totals.AddAttempt(task.plan.tile, task.attempt(), static_cast<int>(failed));
    if (task.superseded) job.totals.AddSuperseded(i, task.plan.tile);
  }
}

void Ledger::PlanAgainBehindCuts(Job& job, int failed) {
  const bool fine = IsOfFinePart(job, job.tasks[failed].plan);
  const int first = FirstBehindCuts(job, fine);
  if (first == static_cast<int>(job.tasks.size())) return;  // not planned yet
  job.replan_from = job.replan_from < 0 ? first : std::min(job.replan_from, first);
  if (fine) return;
  // The fine part follows anew, with all tiles that the coarse part has.
  std::erase_if(job.quarantined,
                [&](const QuarantinedTile& each) { return IsOfFinePart(job, job.tasks[each.task].plan); });
}

void Ledger::ApplyQuarantined(const v1::TileQuarantined& change) {
  const int index = *FindJob(change.job());
  Job& job = jobs_[index];
  Supersede({index, change.task()});
  PlanAgainBehindCuts(job, change.task());
  const auto place = std::lower_bound(job.quarantined.begin(), job.quarantined.end(), change.tile(),
                                      [](const QuarantinedTile& each, int tile) { return each.tile < tile; });
  const QuarantinedTile quarantined = {change.tile(), change.task()};
  if (place == job.quarantined.end() || place->tile != change.tile()) {
    job.quarantined.insert(place, quarantined);
  } else if (FailedBefore(FailedTileOf(job, quarantined), FailedTileOf(job, *place))) {
    // The tile is quarantined already, and a result of an earlier task was lost and could not be made again. The new
    // plan must be without that task, or it would fail again and again.
    *place = quarantined;
  }
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

// Failed and cancelled tasks wait again with their attempts forgiven; succeeded ones stay. Jobs with quarantined tiles
// are planned again, because the old plan lacks these tiles.
void Ledger::ApplyRetried(const v1::JobRetried& change) {
  const int index = *FindJob(change.job());
  Job& job = jobs_[index];
  JobHeader& header = job.header;
  header.state = header.start_us > 0 ? JobState::kRunning : JobState::kQueued;
  header.error.clear();
  header.bad_input = false;
  header.end_us = 0;
  active_jobs_.insert(std::lower_bound(active_jobs_.begin(), active_jobs_.end(), index), index);
  ready_.SetJob(index, header.priority, header.paused);
  const std::vector<QuarantinedTile> before = job.quarantined;
  if (change.has_tile()) {
    std::erase_if(job.quarantined, [&](const QuarantinedTile& each) { return each.tile == change.tile(); });
  } else {
    job.quarantined.clear();
  }
  for (const QuarantinedTile& each : before) {
    if (!change.has_tile() || each.tile == change.tile()) PlanAgainBehindCuts(job, each.task);
  }
  for (const QuarantinedTile& each : before) {
    if (change.has_tile() && each.tile != change.tile()) continue;
    JobTask& failed = job.tasks[each.task];
    // The new plan has a new task for others, also for cuts behind a coarse part that is planned again.
    if (failed.plan.kind != kCutKind || (job.replan_from >= 0 && each.task >= job.replan_from)) continue;
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

void Ledger::ApplyLost(const v1::ResultLost& change) {
  const TaskRef ref = *FindTask(change.task());
  JobTask& target = jobs_[ref.job].tasks[ref.task];
  if (!target.remaking) Unmake(ref);
  if (HasEnded(jobs_[ref.job].header.state)) remakes_of_ended_.insert(ref);
  const auto await = [&](TaskRef reader) {
    std::vector<TaskRef>& waiting = target.awaited_by.Edit();
    if (std::find(waiting.begin(), waiting.end(), reader) != waiting.end()) return false;
    waiting.push_back(reader);
    return true;
  };
  for (const std::string& name : change.needed_by_tasks()) {
    const TaskRef reader = *FindTask(name);
    if (!await(reader)) continue;
    JobTask& given = jobs_[reader.job].tasks[reader.task];
    if (!given.remaking) Unmake(reader);
    ++given.missing;
  }
  for (const std::string& name : change.needed_by_jobs()) {
    const int job = *FindJob(name);
    if (await({job, -1})) ++jobs_[job].lost;
    UpdateDue(job);
  }
  ReadyTask(ref);
}

void Ledger::Unmake(TaskRef ref) {
  Job& job = jobs_[ref.job];
  JobTask& target = job.tasks[ref.task];
  results_.Remove(ref);
  target.state = TaskState::kWaiting;
  target.remaking = true;
  ++target.remakes;
  target.retry_delay_us = 0;
  ++job.unfinished;
  ++job.lost;
  if (target.plan.given->empty() && !target.superseded && !HasEnded(job.header.state))
    job.totals.AddLost(ref.task, target);
  for (const int index : target.readers) {
    JobTask& reader = job.tasks[index];
    ++reader.missing;
    if (reader.state != TaskState::kReady) continue;
    ready_.Remove({ref.job, index}, reader);
    reader.state = TaskState::kWaiting;
  }
  UpdateDue(ref.job);
}

void Ledger::EndRemake(TaskRef ref) {
  JobTask& made = jobs_[ref.job].tasks[ref.task];
  made.remaking = false;
  --jobs_[ref.job].lost;
  remakes_of_ended_.erase(ref);
  for (const TaskRef waiting : std::exchange(made.awaited_by.Edit(), {})) {
    Job& job = jobs_[waiting.job];
    if (HasEnded(job.header.state)) continue;
    if (waiting.task < 0) {
      --job.lost;
    } else if (JobTask& given = job.tasks[waiting.task]; --given.missing == 0 && given.remaking) {
      given.state = TaskState::kSucceeded;
      given.remaking = false;
      --job.unfinished;
      --job.lost;
      for (const int reader : given.readers) {
        --job.tasks[reader].missing;
        ReadyTask({waiting.job, reader});
      }
    }
    UpdateDue(waiting.job);
  }
}

// Readers in the same ended job may be waiting to be recomputed too, and fail with it. So the loop follows readers
// until it reaches the active jobs that asked for the result.
void Ledger::GiveUpRemake(TaskRef first, const TaskFailure& failure) {
  std::vector<TaskRef> given_up = {first};
  for (size_t at = 0; at < given_up.size(); ++at) {  // the loop appends
    const TaskRef ref = given_up[at];
    Job& job = jobs_[ref.job];
    JobTask& target = job.tasks[ref.task];
    target.state = TaskState::kSucceeded;
    target.remaking = false;
    --job.unfinished;
    --job.lost;
    remakes_of_ended_.erase(ref);
    for (const int index : target.readers) {
      JobTask& reader = job.tasks[index];
      const bool waits = --reader.missing >= 0 && reader.remaking && reader.state == TaskState::kWaiting;
      const TaskRef next = {ref.job, index};
      if (waits && std::find(given_up.begin(), given_up.end(), next) == given_up.end()) given_up.push_back(next);
    }
    for (const TaskRef waiting : std::exchange(target.awaited_by.Edit(), {})) {
      Job& other = jobs_[waiting.job];
      if (HasEnded(other.header.state)) continue;
      const std::string error = job.header.name + ", '" + target.plan.name + "': its lost result cannot be " +
                                "recomputed: " + failure.message;
      if (waiting.task < 0) {
        other.lost_error = error;
      } else {
        JobTask& given = other.tasks[waiting.task];
        given.state = TaskState::kFailed;
        given.error = TaskFailure{failure.error_class, error};
        other.failed = other.failed < 0 ? waiting.task : std::min(other.failed, waiting.task);
      }
      ready_.DropJob(waiting.job);  // the planning loop ends the job
      UpdateDue(waiting.job);
    }
  }
}

void Ledger::DropReady(int job) {
  ready_.DropJob(job);
  std::erase_if(newly_ready_, [&](TaskRef ref) { return ref.job == job; });
}

void Ledger::FillJobsUpTo(int index) {
  while (static_cast<int>(jobs_.size()) < index) {
    const int number = static_cast<int>(jobs_.size());
    Job& filled = jobs_.emplace_back();
    filled.header.name = JobName(number);
    filled.deleted = expected_deleted_.contains(number);
    filled.header.state = filled.deleted ? JobState::kCancelled : JobState::kFailed;
    if (!filled.deleted) filled.header.error = "its acceptance record cannot be used; submit the job again";
  }
}

void Ledger::ApplyDeleted(const v1::JobDeleted& change) {
  const int index = *ParseJobName(change.job());
  FillJobsUpTo(index + 1);
  Job& job = jobs_[index];
  if (job.deleted) return;
  std::erase_if(job_of_request_, [&](const auto& request) { return request.second == index; });
  scene_files_.Remove(job);
  DropReady(index);  // tasks that recompute lost results
  remakes_of_ended_.erase(remakes_of_ended_.lower_bound({index, -1}), remakes_of_ended_.lower_bound({index + 1, -1}));
  Job left;
  left.header.name = std::move(job.header.name);
  left.header.state = JobState::kCancelled;
  left.tasks = std::move(job.tasks);  // FreeDeleted frees them in steps
  left.deleted = true;
  if (!left.tasks.empty()) to_free_.push_back(index);
  job = std::move(left);
}

void Ledger::ApplyRestarted(const v1::JobRestarted& change) {
  const int index = *FindJob(change.job());
  Job& job = jobs_[index];
  for (int task = 0; task < static_cast<int>(job.tasks.size()); ++task) results_.Remove({index, task});
  DropReady(index);
  // The new plan may not read the results that the old one waited for.
  for (const TaskRef ref : remakes_of_ended_) {
    std::erase_if(jobs_[ref.job].tasks[ref.task].awaited_by.Edit(),
                  [&](TaskRef waiting) { return waiting.job == index; });
  }
  Job restarted;
  restarted.header = std::move(job.header);
  restarted.scene_files = std::move(job.scene_files);
  restarted.artifacts = std::move(job.artifacts);
  restarted.header.state = JobState::kQueued;
  restarted.header.start_us = 0;
  restarted.header.warnings.push_back("restarted with algorithm version " + change.algorithm_version() +
                                      ": results of version " + restarted.header.algorithm_version +
                                      " cannot be combined with its results");
  restarted.header.algorithm_version = change.algorithm_version();
  job = std::move(restarted);
  ready_.SetJob(index, job.header.priority, job.header.paused);
  UpdateDue(index);
}

bool Ledger::FreeDeleted(int max_tasks) {
  while (!to_free_.empty()) {
    const int index = to_free_.back();
    std::deque<JobTask>& tasks = jobs_[index].tasks;
    for (; max_tasks > 0 && !tasks.empty(); --max_tasks) {
      results_.Remove({index, static_cast<int>(tasks.size()) - 1});
      tasks.pop_back();
    }
    if (!tasks.empty()) return true;
    tasks.shrink_to_fit();
    to_free_.pop_back();
  }
  return false;
}

}  // namespace tessera
