#include "server/demand/demand.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "common/job/end_margin.h"
#include "server/ledger/task_groups.h"

namespace tessera {
namespace {

// Whether a worker of the class lives long enough for a task.
bool HasTime(const WorkerClass& worker, double core_s) {
  return worker.time_limit_s <= 0 || core_s / std::max(1, worker.cores) + kEndMargin_s <= worker.time_limit_s;
}

// Index of the smallest class with `has_memory` and time; none if there is none.
template <class HasMemory>
std::optional<size_t> SmallestClass(const std::vector<WorkerClass>& classes, double core_s,
                                    const HasMemory& has_memory) {
  for (size_t i = 0; i < classes.size(); ++i) {
    if (has_memory(classes[i]) && HasTime(classes[i], core_s)) return i;
  }
  return std::nullopt;
}

bool FitsMemory(int step, const WorkerClass& worker) {
  return worker.memory_bytes == std::numeric_limits<int64_t>::max() ||
         std::exp2(step / 16.0) * (1 << 30) <= static_cast<double>(worker.memory_bytes);
}

// Adds up the tasks of all jobs.
class Sums {
 public:
  Sums(const Ledger& ledger, const std::vector<WorkerClass>& classes)
      : ledger_(ledger), classes_(classes), widths_(classes.size()) {
    demand_.classes.resize(classes.size());
  }

  void AddJob(int index) {
    const Job& job = ledger_.jobs()[index];
    const bool all = !job.planned_to_end;
    Widths widths;
    std::set<std::pair<int, int>> unclear;  // phases with tasks that perhaps fit no class
    for (const auto& [key, work] : job.totals.work()) {
      const int64_t tasks = all ? work.planned : work.unfinished;
      if (tasks == 0) continue;
      const auto found = SmallestClass(classes_, work.most_core_s,
                                       [step = key.second](const WorkerClass& each) { return FitsMemory(step, each); });
      if (found) {
        widths.Of(key.first, classes_.size())[*found] += tasks;
        demand_.classes[*found].core_s += all ? work.planned_core_s : work.unfinished_core_s;
      } else {
        unclear.insert(key);
      }
    }
    for (int i = 0; !unclear.empty() && i < static_cast<int>(job.tasks.size()); ++i) {
      const JobTask& task = job.tasks[i];
      if (task.superseded || !task.plan.given->empty() || (!all && task.state == TaskState::kSucceeded)) continue;
      if (unclear.contains({task.depth, MemoryStep(task.plan.peak_bytes)})) AddTask({index, i}, widths);
    }
    Add(widths);
  }

  // Tasks of ended jobs whose results are needed again.
  void AddRemakes() {
    Widths widths;
    for (const TaskRef ref : ledger_.remakes_of_ended()) AddTask(ref, widths);
    Add(widths);
  }

  Demand Take(double worth_s) {
    double worth = 0;  // workers that have enough work
    for (size_t i = classes_.size(); i-- > 0;) {
      ClassDemand& of_class = demand_.classes[i];
      of_class.core_s = std::max(0.0, of_class.core_s);
      worth += of_class.core_s / (worth_s * std::max(1, classes_[i].cores));
      const double most = std::min(static_cast<double>(widths_[i]), std::max(1.0, std::floor(worth)));
      of_class.workers = static_cast<int>(std::min(most, static_cast<double>(std::numeric_limits<int>::max())));
    }
    return std::move(demand_);
  }

 private:
  // Number of tasks by depth and class.
  struct Widths {
    std::vector<int64_t>& Of(int depth, size_t classes) {
      std::vector<int64_t>& of_depth = by_depth[depth];
      of_depth.resize(classes);
      return of_depth;
    }
    std::map<int, std::vector<int64_t>> by_depth;
  };

  void AddTask(TaskRef ref, Widths& widths) {
    const JobTask& task = ledger_.task(ref);
    const auto found = SmallestClass(classes_, task.plan.cost, [&task](const WorkerClass& each) {
      return task.plan.peak_bytes <= each.memory_bytes;
    });
    if (found) {
      ++widths.Of(task.depth, classes_.size())[*found];
      demand_.classes[*found].core_s += task.plan.cost;
    } else {
      ++demand_.unfit_count;
      if (demand_.unfit.size() < kUnfitTold) demand_.unfit.push_back(ref);
    }
  }

  // Adds a job's widest phase, of each class with all larger ones.
  void Add(const Widths& widths) {
    std::vector<int64_t> widest(classes_.size());
    for (const auto& [depth, tasks] : widths.by_depth) {
      int64_t from_here = 0;
      for (size_t i = classes_.size(); i-- > 0;) {
        from_here += tasks[i];
        widest[i] = std::max(widest[i], from_here);
      }
    }
    for (size_t i = 0; i < widest.size(); ++i) widths_[i] += widest[i];
  }

  const Ledger& ledger_;
  const std::vector<WorkerClass>& classes_;
  std::vector<int64_t> widths_;  // of a class and all larger ones
  Demand demand_;
};

}  // namespace

std::vector<WorkerClass> DefaultClasses() {
  std::vector<WorkerClass> classes;
  for (const int gib : kMemoryClasses_GiB) classes.push_back({int64_t{gib} << 30});
  classes.push_back({std::numeric_limits<int64_t>::max()});
  return classes;
}

Demand DemandOf(const Ledger& ledger, const std::vector<WorkerClass>& classes, double worth_s) {
  Sums sums(ledger, classes);
  for (const int job : ledger.active_jobs()) {
    if (!ledger.jobs()[job].header.paused && !ledger.ready().IsHeld(job)) sums.AddJob(job);
  }
  sums.AddRemakes();
  return sums.Take(worth_s);
}

}  // namespace tessera
