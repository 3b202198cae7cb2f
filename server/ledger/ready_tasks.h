// The tasks that may be leased, in the order in which workers get them.
#pragma once

#include <compare>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "server/ledger/job.h"
#include "server/ledger/task_groups.h"

namespace tessera {

// An index over a ledger's ready tasks. Jobs are ordered by priority, then age; paused and held jobs are skipped. Tasks
// of a job are ordered by depth (lowest first), then cost (highest first), then index. A lookup takes logarithmic time
// unless the filter refuses tasks. Not thread-safe.
class ReadyTasks {
 public:
  // Adds a ready task. Its retry delay, if any, starts at the next Promote.
  void Add(TaskRef ref, const JobTask& task);
  // No effect if the task is absent.
  void Remove(TaskRef ref, const JobTask& task);
  // Removes the tasks and settings of a job.
  void DropJob(int job);
  // The default is priority 0, not paused.
  void SetJob(int job, int priority, bool paused);
  // Skips the job, like a paused one, until it is admitted.
  void Hold(int job) { SetHeld(job, true); }
  void Admit(int job) { SetHeld(job, false); }
  bool IsHeld(int job) const { return StandingOf(job).held; }
  // Held jobs by priority, then age.
  std::vector<int> held() const;

  // Starts new delays and lists tasks whose delay has elapsed. `now_us`: Clock::MonotonicUs.
  void Promote(int64_t now_us);
  // Number of tasks without a running delay, in jobs that are neither paused nor held.
  int count() const { return count_; }

  // The tasks of count() by kind and memory.
  std::map<TaskGroup, int64_t> Groups() const;
  // Time (NoteTime) at which the oldest task of count() was added.
  std::optional<int64_t> OldestSince() const;
  // Sets the time of later additions. `now_us`: Unix time.
  void NoteTime(int64_t now_us) { now_us_ = now_us; }
  int64_t now_us() const { return now_us_; }
  // Number of delayed tasks of all jobs.
  int delayed_count() const { return static_cast<int>(delayed_.size()); }

  // The first job in the order.
  std::optional<int> FirstJob() const;
  // First task of the job without a delay, even if the job is paused or held.
  std::optional<TaskRef> FirstOfJob(int job) const;
  // The delayed task of the job that becomes ready first, and when. A delay that has not started counts from `now_us`.
  std::optional<std::pair<int64_t, TaskRef>> NextOfDelayed(int job, int64_t now_us) const;

  // Returns whether a task may be leased; called in order until it accepts one.
  using Filter = std::function<bool(TaskRef ref)>;
  std::optional<TaskRef> First(const Filter& filter) const;
  std::optional<TaskRef> FirstOfTile(int job, int tile, const Filter& filter) const;

 private:
  struct Rank {
    int depth = 0;
    double negative_cost = 0;
    int task = -1;
    friend auto operator<=>(const Rank&, const Rank&) = default;
  };
  struct OfJob {
    std::map<Rank, int64_t> all;  // time of addition
    std::map<int, std::set<Rank>> of_tile;
    std::map<TaskGroup, int64_t> of_group;           // number of tasks
    std::set<std::pair<int64_t, int>> by_time = {};  // time of addition, task
  };
  struct Place {
    Rank rank;
    int tile = -1;
    TaskGroup group = {};
  };
  struct Delayed {
    Place place;
    int64_t delay_us = 0;
    int64_t end_us = 0;  // 0: not started
  };
  struct Standing {
    int priority = 0;
    bool paused = false, held = false;
    bool listed() const { return !paused && !held; }
  };
  static Rank RankOf(TaskRef ref, const JobTask& task) { return {task.depth, -task.plan.cost, ref.task}; }
  static TaskGroup GroupOf(const JobTask& task) {
    return {KindIndex(task.plan.kind.str()), MemoryClass(task.plan.peak_bytes)};
  }
  Standing StandingOf(int job) const;
  void SetStanding(int job, const Standing& standing);
  void SetHeld(int job, bool held);
  // Add the job to order_ if it has tasks and is listed, or remove it.
  void List(int job);
  void Unlist(int job);
  void Insert(TaskRef ref, const Place& place);
  void DropDelayed(TaskRef ref);

  std::map<int, OfJob> jobs_;
  std::map<int, Standing> standings_;    // of jobs that differ from the default
  std::set<std::pair<int, int>> order_;  // (-priority, job) of listed jobs with tasks
  std::map<TaskRef, Delayed> delayed_;
  std::set<TaskRef> to_begin_;                    // delays not started
  std::set<std::pair<int64_t, TaskRef>> by_end_;  // delays started
  int count_ = 0;
  int64_t now_us_ = 0;
};

}  // namespace tessera
