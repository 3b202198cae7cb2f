// Lost results: the tasks that made them run again, and their readers wait.
#include <algorithm>
#include <utility>

#include "server/ledger/ledger.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

// Breadth first over the bases, because an update may have two (its base and a rollback target) that share ancestors.
// A given task only passes a content on, so the search continues to the task that computed it.
StatusOr<TaskRef> Ledger::MakerOf(int job, const Digest& digest, bool own) const {
  const auto sha256 = Sha256::FromHex(digest.sha256);
  std::vector<int> search = {job};
  for (size_t at = 0; at < search.size(); ++at) {
    const Job& searched = jobs_[search[at]];
    if (searched.deleted) continue;
    for (int task = 0; (at > 0 || own) && task < static_cast<int>(searched.tasks.size()); ++task) {
      const JobTask& made = searched.tasks[task];
      if (!made.plan.given->empty() || (made.state != TaskState::kSucceeded && !made.remaking)) continue;
      const auto is_it = [&](const StoredFile& output) { return output.sha256 == sha256; };
      if (std::any_of(made.outputs.begin(), made.outputs.end(), is_it)) return TaskRef{search[at], task};
    }
    const UpdateSettings& update = searched.header.settings.update;
    for (const std::string& name : {update.base, update.rollback_to}) {
      const auto base = FindJob(name);
      if (base.ok() && std::find(search.begin(), search.end(), *base) == search.end()) search.push_back(*base);
    }
  }
  return absl::NotFoundError("no task of " + JobName(job) + " or of its base jobs made " + digest.sha256);
}

Status Ledger::CheckLost(const v1::ResultLost& change) const {
  TESSERA_ASSIGN_OR_RETURN(const TaskRef ref, FindTask(change.task()));
  const JobTask& target = task(ref);
  const JobHeader& header = jobs_[ref.job].header;
  if (!target.plan.given->empty())
    return absl::FailedPreconditionError(change.task() + " is given: its outputs come from a base job");
  if (target.state != TaskState::kSucceeded && !target.remaking) {
    return absl::FailedPreconditionError(change.task() + " has no result");
  }
  if (HasEnded(header.state) && header.state != JobState::kSucceeded && header.state != JobState::kPartial) {
    return absl::FailedPreconditionError(change.task() + ": its job has ended without a result");
  }
  for (const std::string& name : change.needed_by_tasks()) {
    TESSERA_ASSIGN_OR_RETURN(const TaskRef reader, FindTask(name));
    const JobTask& given = task(reader);
    if (given.plan.given->empty() || HasEnded(jobs_[reader.job].header.state) || given.state == TaskState::kFailed) {
      return absl::FailedPreconditionError(name + " has no outputs of a base job, or has failed, or its job has ended");
    }
  }
  for (const std::string& name : change.needed_by_jobs()) {
    TESSERA_ASSIGN_OR_RETURN(const int job, FindJob(name));
    if (HasEnded(jobs_[job].header.state)) return absl::FailedPreconditionError(name + " has ended");
  }
  return absl::OkStatus();
}

Status Ledger::CheckSameAsBefore(TaskRef ref, const std::vector<NamedDigest>& outputs) const {
  const JobTask& target = task(ref);
  if (!target.remaking) return absl::OkStatus();
  for (const StoredFile& before : target.outputs) {
    const auto now = std::find_if(outputs.begin(), outputs.end(),
                                  [&](const NamedDigest& output) { return output.name == before.name; });
    if (now != outputs.end() && now->digest == before.digest()) continue;
    return absl::FailedPreconditionError(
        "'" + target.plan.name + "' was recomputed with another result, but the first was already read: output " +
        before.name.str() + ": found " + (now == outputs.end() ? "none" : now->digest.sha256) + ", expected " +
        before.sha256.Hex());
  }
  return absl::OkStatus();
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
  ForgetTask(ref);
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

}  // namespace tessera
