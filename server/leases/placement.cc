#include "server/leases/placement.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "common/job/end_margin.h"
#include "server/leases/worker_evidence.h"

namespace tessera {
namespace {
// Most ready tasks of other workers' tiles that are skipped in search of a tile without a worker.
constexpr int kStrangersSeen = 256;

// A worker waits this long plus the task's predicted time before it takes a task of another worker's tile, because
// reading the tile again takes longer (delay scheduling, Zaharia et al., EuroSys 2010).
constexpr double kPatience_s = 1;

// Whether the task fits the worker's memory, or fits no worker and this one is among the largest.
bool Fits(const Ledger& ledger, TaskRef ref, const LeaseTable& leases, const std::string& worker, int64_t now_us) {
  const int64_t needed_bytes = ledger.task(ref).plan.peak_bytes;
  const auto self = leases.workers().find(worker);
  const int64_t has_bytes = self == leases.workers().end() ? 0 : self->second.info.memory_bytes;
  if (has_bytes == 0 || needed_bytes <= has_bytes) return true;  // 0: unknown
  const LargestWorker largest = leases.Largest();
  return needed_bytes > largest.memory_bytes && has_bytes == largest.memory_bytes &&
         now_us - largest.since_us >= Micros(kLargerWorkerWait_s);
}

// Decides which tasks a worker has time for before its allocation ends.
class TimeRule {
 public:
  TimeRule(const Ledger& ledger, LeaseTable& leases, const std::string& worker, int64_t now_us)
      : leases_(leases), worker_(leases.FindWorker(worker)), now_us_(now_us) {
    if (worker_ == nullptr || worker_->ends_us == 0) return;
    MachineLoad load = leases.LoadOf(worker);
    ++load.running;
    threads_ = ThreadsOfTask(load, ledger.ready().count(), worker_->info.threads);
  }

  // A task that no worker has time for goes to the one with the most time left, after kLongerWorkerWait_s without a
  // task.
  bool Allows(const PlannedTask& task) {
    if (worker_ == nullptr || HasTime(*worker_, task.cost, threads_, now_us_)) return true;
    const double left_s = TimeLeft_s(*worker_, now_us_);
    if (left_s <= kEndMargin_s) return false;
    const Others others = WithMemory(task.peak_bytes);
    if (task.cost <= others.most_core_s || left_s < others.longest_s) return false;
    if (!worker_->short_of_time_since_us) worker_->short_of_time_since_us = now_us_;
    return now_us_ - *worker_->short_of_time_since_us >= Micros(kLongerWorkerWait_s);
  }

 private:
  // Workers with at least so much memory.
  struct Others {
    int64_t memory_bytes = 0;
    double most_core_s = 0;  // work that one of them has time for
    double longest_s = 0;    // the most time that one of them has left
  };

  // All workers with the task's memory; if none has it, those with the most memory.
  Others WithMemory(int64_t bytes) {
    if (by_memory_.empty()) ListWorkers();
    const auto end = std::partition_point(by_memory_.begin(), by_memory_.end(),
                                          [bytes](const Others& each) { return each.memory_bytes >= bytes; });
    return end == by_memory_.begin() ? by_memory_.front() : *(end - 1);
  }

  void ListWorkers() {
    for (const auto& [name, worker] : leases_.workers()) {
      const double left_s = TimeLeft_s(worker, now_us_);
      const int64_t memory_bytes = worker.info.memory_bytes;
      by_memory_.push_back({memory_bytes == 0 ? std::numeric_limits<int64_t>::max() : memory_bytes,  // 0: unknown
                            (left_s - kEndMargin_s) * std::max(1, worker.info.threads), left_s});
    }
    std::sort(by_memory_.begin(), by_memory_.end(),
              [](const Others& a, const Others& b) { return a.memory_bytes > b.memory_bytes; });
    for (size_t i = 1; i < by_memory_.size(); ++i) {
      Others& each = by_memory_[i];
      each.most_core_s = std::max(each.most_core_s, by_memory_[i - 1].most_core_s);
      each.longest_s = std::max(each.longest_s, by_memory_[i - 1].longest_s);
    }
  }

  LeaseTable& leases_;
  WorkerState* const worker_;  // null: unknown
  const int64_t now_us_;
  int threads_ = 1;
  std::vector<Others> by_memory_;  // largest memory first, each with the values of those before it
};

}  // namespace

Placement PlaceTask(Ledger& ledger, LeaseTable& leases, const std::string& worker, double waited_s, int64_t now_us) {
  ledger.ready().Promote(now_us);
  const WorkerState* const self = leases.FindWorker(worker);
  if (self != nullptr && IsSuspended(*self, now_us)) return {};
  const ReadyTasks& ready = ledger.ready();
  TimeRule time(ledger, leases, worker, now_us);
  const auto may_run = [&](TaskRef ref) {
    return MayTry(ledger.task(ref), worker, leases, now_us) && Fits(ledger, ref, leases, worker, now_us) &&
           time.Allows(ledger.task(ref).plan);
  };
  const std::optional<TaskRef> first = ready.First(may_run);
  if (!first || self == nullptr) return {first};
  // Prefer a tile in this worker's memory, then a tile of no other worker. After the wait any task will do, so no
  // ready task stays unleased.
  for (const TileRef tile : self->recent_tiles) {
    if (tile.job != first->job) continue;
    if (const auto own = ready.FirstOfTile(tile.job, tile.tile, may_run)) return {own};
  }
  int seen = 0;
  const auto nobodys = ready.First([&](TaskRef ref) {
    if (ref.job != first->job || ++seen > kStrangersSeen) return true;
    const std::string& last_worker = leases.LastWorkerOf({ref.job, ledger.task(ref).plan.tile});
    return (last_worker.empty() || last_worker == worker) && may_run(ref);
  });
  if (nobodys && nobodys->job == first->job && seen <= kStrangersSeen) return {nobodys};
  const bool left_to_others = seen <= kStrangersSeen && waited_s < kPatience_s + ledger.task(*first).plan.cost;
  return {left_to_others ? std::nullopt : first, left_to_others};
}

}  // namespace tessera
