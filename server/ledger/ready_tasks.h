// The tasks that could be leased now, in the order in which workers get them.
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

// An index over a ledger's ready tasks: nothing that it holds is not in the ledger too. Jobs of a higher priority come
// first, of these the older ones, those that are paused or held never; in a job the tasks that most others wait for
// (those with the fewest steps behind them), of these the dearest, of these the first of the plan. A lookup takes
// logarithmic time unless tasks are refused. Not thread-safe.
class ReadyTasks {
 public:
  // A ready task. One with a delay is found when that has passed since the next Promote.
  void Add(TaskRef ref, const JobTask& task);
  // Nothing if it is not there.
  void Remove(TaskRef ref, const JobTask& task);
  // What is ready of a job that ends, and its priority.
  void DropJob(int job);
  // Without it a job has priority 0 and is not paused.
  void SetJob(int job, int priority, bool paused);
  // Nothing of the job is found until it is admitted, as if it were paused.
  void Hold(int job) { SetHeld(job, true); }
  void Admit(int job) { SetHeld(job, false); }
  bool IsHeld(int job) const { return StandingOf(job).held; }
  // Those held, in the order in which they would come.
  std::vector<int> held() const;

  // Ends the delays that are over. `now_us`: Clock::MonotonicUs.
  void Promote(int64_t now_us);
  // Of all jobs that are neither paused nor held, promoted ones only.
  int count() const { return count_; }

  // What is counted, by kind and memory.
  std::map<TaskGroup, int64_t> Groups() const;
  // When that of these that has been there longest came, in the time of NoteTime; none if there is none.
  std::optional<int64_t> OldestSince() const;
  // `now_us`: Unix time; tasks that come from now on came then.
  void NoteTime(int64_t now_us) { now_us_ = now_us; }
  int64_t now_us() const { return now_us_; }
  // Those with a delay, of all jobs.
  int delayed_count() const { return static_cast<int>(delayed_.size()); }

  // The job whose tasks come first.
  std::optional<int> FirstJob() const;
  // Of a job, paused or not, the first that has no delay.
  std::optional<TaskRef> FirstOfJob(int job) const;
  // Of a job that which comes next of those with a delay, and when; whole delays of those that have not begun.
  std::optional<std::pair<int64_t, TaskRef>> NextOfDelayed(int job, int64_t now_us) const;

  // Whether a task may be given; asked in the order above until one may.
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
    std::map<Rank, int64_t> all;  // when each came
    std::map<int, std::set<Rank>> of_tile;
    std::map<TaskGroup, int64_t> of_group;           // how many
    std::set<std::pair<int64_t, int>> by_time = {};  // when, task
  };
  struct Place {
    Rank rank;
    int tile = -1;
    TaskGroup group = {};
  };
  struct Delayed {
    Place place;
    int64_t delay_us = 0;
    int64_t end_us = 0;  // 0: it has not begun
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
  // A job that has tasks now enters the order of jobs, or leaves it.
  void List(int job);
  void Unlist(int job);
  void Insert(TaskRef ref, const Place& place);
  void DropDelayed(TaskRef ref);

  std::map<int, OfJob> jobs_;
  std::map<int, Standing> standings_;    // those that are not as they are without SetJob
  std::set<std::pair<int, int>> order_;  // (-priority, job) of jobs_ that are listed
  std::map<TaskRef, Delayed> delayed_;
  std::set<TaskRef> to_begin_;                    // of delayed_
  std::set<std::pair<int64_t, TaskRef>> by_end_;  // of delayed_, those that have begun
  int count_ = 0;
  int64_t now_us_ = 0;
};

}  // namespace tessera
