// Jobs and tasks as callers see them.
#include <algorithm>

#include "server/jobs/dispatcher.h"

namespace tessera {

JobStatus Dispatcher::StoredStatusLocked(int job) const {
  JobStatus status = JobStatusLocked(job);
  const auto end = end_records_.find(job);
  if (end != end_records_.end() && end->second > journal_.stored()) TakeEndFrom(status);
  return status;
}

std::vector<JobStatus> Dispatcher::ListJobs(int before, int count) const {
  std::lock_guard lock(mutex_);
  std::vector<JobStatus> jobs;
  const int size = static_cast<int>(ledger_.jobs().size());
  int index = before < 0 || before > size ? size : before;
  while (--index >= 0 && static_cast<int>(jobs.size()) < count) {
    if (ledger_.WasDeleted(index)) continue;
    jobs.push_back(StoredStatusLocked(index));
  }
  return jobs;
}

StatusOr<std::vector<TaskStatus>> Dispatcher::ListTasks(const std::string& name, int first, int count) const {
  std::lock_guard lock(mutex_);
  TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
  std::vector<TaskStatus> tasks;
  const int size = static_cast<int>(ledger_.jobs()[job].tasks.size());
  for (int i = std::max(0, first); i < size && static_cast<int>(tasks.size()) < count; ++i) {
    tasks.push_back(StatusOfTask(ledger_.jobs()[job], {job, i}, leases_));
  }
  return tasks;
}

StatusOr<std::vector<TaskStatus>> Dispatcher::RunningTasks(const std::string& name) const {
  std::lock_guard lock(mutex_);
  TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
  std::vector<TaskStatus> tasks;
  for (const TaskRef ref : leases_.OfJob(job)) {
    tasks.push_back(StatusOfTask(ledger_.jobs()[job], ref, leases_));
  }
  return tasks;
}

StatusOr<WatchedJob> Dispatcher::LookAtJob(const std::string& name, size_t max_running) const {
  std::lock_guard lock(mutex_);
  TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
  WatchedJob watched{StoredStatusLocked(job), {}};
  watched.end_waits = HasEnded(ledger_.jobs()[job].header.state) && !HasEnded(watched.job.header.state);
  for (const TaskRef ref : leases_.OfJob(job)) {
    if (watched.running.size() == max_running) break;
    watched.running.push_back(StatusOfTask(ledger_.jobs()[job], ref, leases_));
  }
  return watched;
}

}  // namespace tessera
