#include "server/dispatch/ready_tasks.h"

namespace tessera {

void ReadyTasks::Insert(TaskRef ref, const Place& place) {
  OfJob& job = jobs_[ref.job];
  if (!job.all.insert(place.rank).second) return;
  job.of_tile[place.tile].insert(place.rank);
  ++count_;
}

void ReadyTasks::Add(TaskRef ref, const JobTask& task) {
  const Place place = {RankOf(ref, task), task.plan.tile};
  if (task.retry_us > 0) {
    delayed_[{task.retry_us, ref}] = place;
  } else {
    Insert(ref, place);
  }
}

void ReadyTasks::Remove(TaskRef ref, const JobTask& task) {
  delayed_.erase({task.retry_us, ref});
  const auto job = jobs_.find(ref.job);
  if (job == jobs_.end()) return;
  const Rank rank = RankOf(ref, task);
  if (job->second.all.erase(rank) == 0) return;
  --count_;
  const auto tile = job->second.of_tile.find(task.plan.tile);
  tile->second.erase(rank);
  if (tile->second.empty()) job->second.of_tile.erase(tile);
  if (job->second.all.empty()) jobs_.erase(job);
}

void ReadyTasks::DropJob(int job) {
  std::erase_if(delayed_, [job](const auto& entry) { return entry.first.ref.job == job; });
  const auto found = jobs_.find(job);
  if (found == jobs_.end()) return;
  count_ -= static_cast<int>(found->second.all.size());
  jobs_.erase(found);
}

void ReadyTasks::Promote(int64_t now_us) {
  while (!delayed_.empty() && delayed_.begin()->first.retry_us <= now_us) {
    Insert(delayed_.begin()->first.ref, delayed_.begin()->second);
    delayed_.erase(delayed_.begin());
  }
}

std::optional<TaskRef> ReadyTasks::First(const Filter& filter) const {
  for (const auto& [index, job] : jobs_) {
    for (const Rank& rank : job.all) {
      const TaskRef ref = {index, rank.task};
      if (filter(ref)) return ref;
    }
  }
  return std::nullopt;
}

std::optional<TaskRef> ReadyTasks::FirstOfTile(int job, int tile, const Filter& filter) const {
  const auto found = jobs_.find(job);
  if (found == jobs_.end()) return std::nullopt;
  const auto of_tile = found->second.of_tile.find(tile);
  if (of_tile == found->second.of_tile.end()) return std::nullopt;
  for (const Rank& rank : of_tile->second) {
    const TaskRef ref = {job, rank.task};
    if (filter(ref)) return ref;
  }
  return std::nullopt;
}

}  // namespace tessera
