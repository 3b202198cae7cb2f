#include "server/ledger/ready_tasks.h"

#include <algorithm>

namespace tessera {

ReadyTasks::Standing ReadyTasks::StandingOf(int job) const {
  const auto found = standings_.find(job);
  return found == standings_.end() ? Standing() : found->second;
}

void ReadyTasks::List(int job) {
  const Standing standing = StandingOf(job);
  const auto found = jobs_.find(job);
  if (!standing.listed() || found == jobs_.end()) return;
  if (order_.insert({-standing.priority, job}).second) count_ += static_cast<int>(found->second.all.size());
}

void ReadyTasks::Unlist(int job) {
  if (order_.erase({-StandingOf(job).priority, job}) > 0) count_ -= static_cast<int>(jobs_.at(job).all.size());
}

void ReadyTasks::SetStanding(int job, const Standing& standing) {
  Unlist(job);
  if (standing.priority == 0 && standing.listed()) {
    standings_.erase(job);
  } else {
    standings_[job] = standing;
  }
  List(job);
}

void ReadyTasks::SetJob(int job, int priority, bool paused) {
  SetStanding(job, {priority, paused, StandingOf(job).held});
}

void ReadyTasks::SetHeld(int job, bool held) {
  Standing standing = StandingOf(job);
  standing.held = held;
  SetStanding(job, standing);
}

std::vector<int> ReadyTasks::held() const {
  std::vector<int> jobs;
  for (const auto& [job, standing] : standings_) {
    if (standing.held) jobs.push_back(job);
  }
  std::stable_sort(jobs.begin(), jobs.end(),
                   [&](int a, int b) { return standings_.at(a).priority > standings_.at(b).priority; });
  return jobs;
}

void ReadyTasks::Insert(TaskRef ref, const Place& place) {
  OfJob& job = jobs_[ref.job];
  if (!job.all.insert({place.rank, now_us_}).second) return;
  job.of_tile[place.tile].insert(place.rank);
  ++job.of_group[place.group];
  job.by_time.insert({now_us_, ref.task});
  if (job.all.size() == 1) return List(ref.job);
  if (StandingOf(ref.job).listed()) ++count_;
}

void ReadyTasks::Add(TaskRef ref, const JobTask& task) {
  const Place place = {RankOf(ref, task), task.plan.tile, GroupOf(task)};
  if (task.retry_delay_us > 0) {
    delayed_[ref] = {place, task.retry_delay_us};
    to_begin_.insert(ref);
  } else {
    Insert(ref, place);
  }
}

void ReadyTasks::DropDelayed(TaskRef ref) {
  const auto found = delayed_.find(ref);
  if (found == delayed_.end()) return;
  to_begin_.erase(ref);
  by_end_.erase({found->second.end_us, ref});
  delayed_.erase(found);
}

void ReadyTasks::Remove(TaskRef ref, const JobTask& task) {
  DropDelayed(ref);
  const auto job = jobs_.find(ref.job);
  if (job == jobs_.end()) return;
  const Rank rank = RankOf(ref, task);
  const auto found = job->second.all.find(rank);
  if (found == job->second.all.end()) return;
  Unlist(ref.job);
  job->second.by_time.erase({found->second, ref.task});
  job->second.all.erase(found);
  const auto group = job->second.of_group.find(GroupOf(task));
  if (--group->second == 0) job->second.of_group.erase(group);
  const auto tile = job->second.of_tile.find(task.plan.tile);
  tile->second.erase(rank);
  if (tile->second.empty()) job->second.of_tile.erase(tile);
  if (job->second.all.empty()) {
    jobs_.erase(job);
  } else {
    List(ref.job);
  }
}

void ReadyTasks::DropJob(int job) {
  for (auto it = delayed_.lower_bound({job, 0}); it != delayed_.end() && it->first.job == job;) {
    DropDelayed((it++)->first);
  }
  Unlist(job);
  jobs_.erase(job);
  standings_.erase(job);
}

void ReadyTasks::Promote(int64_t now_us) {
  for (const TaskRef ref : to_begin_) {
    Delayed& delayed = delayed_[ref];
    delayed.end_us = now_us + delayed.delay_us;
    by_end_.insert({delayed.end_us, ref});
  }
  to_begin_.clear();
  while (!by_end_.empty() && by_end_.begin()->first <= now_us) {
    const TaskRef ref = by_end_.begin()->second;
    Insert(ref, delayed_[ref].place);
    DropDelayed(ref);
  }
}

std::map<TaskGroup, int64_t> ReadyTasks::Groups() const {
  std::map<TaskGroup, int64_t> groups;
  for (const auto& [negative_priority, job] : order_) {
    for (const auto& [group, count] : jobs_.at(job).of_group) groups[group] += count;
  }
  return groups;
}

std::optional<int64_t> ReadyTasks::OldestSince() const {
  std::optional<int64_t> oldest;
  for (const auto& [negative_priority, job] : order_) {
    const int64_t since_us = jobs_.at(job).by_time.begin()->first;
    if (!oldest || since_us < *oldest) oldest = since_us;
  }
  return oldest;
}

std::optional<int> ReadyTasks::FirstJob() const {
  return order_.empty() ? std::nullopt : std::optional(order_.begin()->second);
}

std::optional<TaskRef> ReadyTasks::FirstOfJob(int job) const {
  const auto found = jobs_.find(job);
  return found == jobs_.end() ? std::nullopt : std::optional(TaskRef{job, found->second.all.begin()->first.task});
}

std::optional<std::pair<int64_t, TaskRef>> ReadyTasks::NextOfDelayed(int job, int64_t now_us) const {
  std::optional<std::pair<int64_t, TaskRef>> next;
  for (auto it = delayed_.lower_bound({job, 0}); it != delayed_.end() && it->first.job == job; ++it) {
    const int64_t end_us = it->second.end_us > 0 ? it->second.end_us : now_us + it->second.delay_us;
    if (!next || end_us < next->first) next = {end_us, it->first};
  }
  return next;
}

std::optional<TaskRef> ReadyTasks::First(const Filter& filter) const {
  for (const auto& [negative_priority, index] : order_) {
    for (const auto& [rank, since_us] : jobs_.at(index).all) {
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
