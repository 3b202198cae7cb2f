// Leases and registered workers. This state is not stored.
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "server/leases/thread_rule.h"
#include "server/ledger/job.h"

namespace tessera {

struct WorkerInfo {
  std::string host;
  int pid = 0;
  int threads = 0;  // thread limit of its tasks
  int64_t memory_bytes = 0;
  int cores = 0;                // of the machine; 0: unknown
  std::string machine = {};     // host, boot and, if a scheduler shares the host out, allocation; empty: unknown
  std::string client = {};      // that registered it
  double time_left_s = 0;       // until its allocation ends, at its registration; 0: no limit
  std::string allocation = {};  // part of `machine`: the scheduler's job; empty: none
};

struct TileRef {
  int job = -1;
  int tile = -1;
  friend auto operator<=>(const TileRef&, const TileRef&) = default;
};

inline int64_t Micros(double seconds) { return static_cast<int64_t>(seconds * 1e6); }

// Expiry of a lease that is not durable yet: it is not sent to the worker, so it cannot expire.
inline constexpr int64_t kNotSent_us = std::numeric_limits<int64_t>::max();

// Times are Clock::MonotonicUs.
struct LeaseState {
  std::string worker;
  int attempt = 0;
  int64_t start_us = 0;
  int64_t expires_us = 0;     // or kNotSent_us
  int64_t progressed_us = 0;  // time of the last change of progress or stage, or kNotSent_us
  int threads = 1;            // thread limit of the task
  double progress = 0;
  std::string stage = {};
};

struct WorkerState {
  WorkerInfo info;
  int64_t last_seen_us = 0;
  bool has_called = true;    // called since the coordinator started; false: only in records
  bool is_restored = false;  // from records, which have its machine alone: it must register again
  int64_t ends_us = 0;       // end of its allocation; 0: no limit
  std::optional<int64_t> short_of_time_since_us = {};  // see placement.cc
  std::vector<TileRef> recent_tiles = {};              // tiles of its tasks, latest first; it may have them in memory
  std::set<TaskRef> tasks = {};                        // leased to it
  // The last call that got a lease (0: none), and that lease.
  int64_t call = 0;
  TaskRef granted = {};
  int granted_attempt = 0;
  // See worker_evidence.h.
  int strikes = 0;  // tasks failed here and completed by others, since its last success
  int times_suspended = 0;
  int64_t suspended_until_us = 0;
  std::string suspended_reason = {};
};

// A task too large for all workers waits this long, after the largest worker registered, for a larger one.
inline constexpr double kLargerWorkerWait_s = 60;

struct LargestWorker {
  int64_t memory_bytes = 0;  // 0: no worker, or unknown
  int64_t since_us = 0;
};

// A worker whose time ends too early for a task, like those of all others, waits this long for one that has more. Less
// than the 60 s after which an idle pilot of deploy/slurm ends.
inline constexpr double kLongerWorkerWait_s = 30;

// Time until the worker's allocation ends; infinity: no limit.
double TimeLeft_s(const WorkerState& worker, int64_t now_us);
// Whether a task that takes `core_s` on `threads` is predicted to end kEndMargin_s before the worker's allocation.
bool HasTime(const WorkerState& worker, double core_s, int threads, int64_t now_us);

// All leases and registered workers. Not thread-safe.
class LeaseTable {
 public:
  const std::map<TaskRef, LeaseState>& leases() const { return leases_; }
  const std::map<std::string, WorkerState>& workers() const { return workers_; }

  int WorkersOf(const std::string& client) const;
  // Null if not registered.
  WorkerState* FindWorker(const std::string& worker);
  void AddWorker(const std::string& worker, const WorkerInfo& info, int64_t now_us);
  // Precondition: the worker has no lease. No effect if it is not registered.
  void RemoveWorker(const std::string& worker);

  // Leases the task to lease.worker.
  LeaseState& Grant(TaskRef ref, LeaseState lease);
  // No effect if the task is not leased.
  void Release(TaskRef ref);
  // Null if the task is not leased.
  const LeaseState* Find(TaskRef ref) const;
  // The lease of this attempt by this worker; null if it is not the current one.
  LeaseState* FindCurrent(TaskRef ref, const std::string& worker, int attempt);
  // Shifts all times by `time_us`, for which the coordinator did not run. No lease gets more than `lease_us` left.
  void ShiftTimes(int64_t time_us, int64_t now_us, int64_t lease_us);
  // Tasks whose leases expired before `now_us`.
  std::vector<TaskRef> Expired(int64_t now_us) const;
  // Leased tasks of the job.
  std::vector<TaskRef> OfJob(int job) const;
  // Notes that the worker got a task of the tile. No effect if it is not registered.
  void NoteTile(const std::string& worker, TileRef tile);
  // Whether a worker on the machine called since `since_us`.
  bool Lives(const std::string& machine, int64_t since_us) const;
  // Of the registered workers. `since_us`: when the first worker of that size registered.
  LargestWorker Largest() const;
  // The worker with the latest task of the tile, if still registered; else empty.
  const std::string& LastWorkerOf(TileRef tile) const;
  // Load of the worker's machine, or of its host if that is unknown. Unknown cores are replaced by the largest thread
  // limit of its workers.
  MachineLoad LoadOf(const std::string& worker) const;
  void DropJob(int job);
  // Removes workers without a lease whose last call was before `before_us`.
  void ForgetSilentWorkers(int64_t before_us);

 private:
  std::map<TaskRef, LeaseState> leases_;
  std::map<std::string, WorkerState> workers_;
  std::map<std::string, std::set<std::string>> workers_of_machine_;
  std::map<std::string, int> workers_of_client_;  // counts above 0
  std::map<TileRef, std::string> last_workers_;
  int64_t largest_since_us_ = 0;
};

}  // namespace tessera
