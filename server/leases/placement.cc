#include "server/leases/placement.h"

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

}  // namespace

Placement PlaceTask(Ledger& ledger, LeaseTable& leases, const std::string& worker, double waited_s, int64_t now_us) {
  ledger.ready().Promote(now_us);
  const WorkerState* const self = leases.FindWorker(worker);
  if (self != nullptr && IsSuspended(*self, now_us)) return {};
  const ReadyTasks& ready = ledger.ready();
  const auto may_run = [&](TaskRef ref) {
    return MayTry(ledger.task(ref), worker, leases, now_us) && Fits(ledger, ref, leases, worker, now_us);
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
