// Leases and registered workers: the state that is not stored.
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "server/leases/thread_rule.h"
#include "server/ledger/job.h"

namespace tessera {

struct WorkerInfo {
  std::string host;
  int pid = 0;
  int threads = 0;  // that its tasks may use at most
  int64_t memory_bytes = 0;
  int cores = 0;             // of the host; 0: not known
  std::string machine = {};  // host and boot; empty: not known
  std::string client = {};   // who registered it
};

// A tile of a job.
struct TileRef {
  int job = -1;
  int tile = -1;
  friend auto operator<=>(const TileRef&, const TileRef&) = default;
};

inline int64_t Micros(double seconds) { return static_cast<int64_t>(seconds * 1e6); }

// Expiry of a lease that is not durable yet: never, because its worker was not given it.
inline constexpr int64_t kUntold_us = std::numeric_limits<int64_t>::max();

// Times are Clock::MonotonicUs.
struct LeaseState {
  std::string worker;
  int attempt = 0;
  int64_t start_us = 0;
  int64_t expires_us = 0;  // or kUntold_us
  int64_t moved_us = 0;    // when progress or stage last changed, or kUntold_us
  int threads = 1;         // that the task may use
  double progress = 0;
  std::string stage = {};
};

struct WorkerState {
  WorkerInfo info;
  int64_t last_seen_us = 0;
  bool heard = true;                       // false: not since the coordinator started; known from records
  std::vector<TileRef> recent_tiles = {};  // of the tasks that it was given, the last first: they may be in its memory
  std::set<TaskRef> tasks = {};            // that it holds leases of
  // Its last call that was given a lease (0: none), and that lease.
  int64_t call = 0;
  TaskRef granted = {};
  int granted_attempt = 0;
  // worker_evidence.h.
  int strikes = 0;  // tasks that it failed and other workers did, since its last success
  int times_suspended = 0;
  int64_t suspended_until_us = 0;
  std::string suspended_reason = {};
};

// A task that fits no worker waits for a larger worker, for this time after the largest was registered.
inline constexpr double kLargerWorkerWait_s = 60;

struct LargestWorker {
  int64_t memory_bytes = 0;  // 0: no worker, or not known
  int64_t since_us = 0;
};

// Not thread-safe.
class LeaseTable {
 public:
  const std::map<TaskRef, LeaseState>& leases() const { return leases_; }
  const std::map<std::string, WorkerState>& workers() const { return workers_; }

  int WorkersOf(const std::string& client) const;
  // Null if there is no such worker.
  WorkerState* FindWorker(const std::string& worker);
  void AddWorker(const std::string& worker, const WorkerInfo& info, int64_t now_us);
  // The worker must hold no lease. Does nothing if it is not registered.
  void RemoveWorker(const std::string& worker);

  // To the worker that the lease names.
  LeaseState& Grant(TaskRef ref, LeaseState lease);
  // Does nothing if the task is not leased.
  void Release(TaskRef ref);
  // Null if the task is not leased.
  const LeaseState* Find(TaskRef ref) const;
  // The lease of this attempt by this worker; null if it is not current.
  LeaseState* FindCurrent(TaskRef ref, const std::string& worker, int attempt);
  // Leaves `time_us` before `now_us` out of all times of leases (which last `lease_us`) and workers.
  void LeaveOut(int64_t time_us, int64_t now_us, int64_t lease_us);
  // Leases that ran out before `now_us`.
  std::vector<TaskRef> Expired(int64_t now_us) const;
  // Leases of tasks of the job.
  std::vector<TaskRef> OfJob(int job) const;
  // Notes that the worker was given a task of the tile. Does nothing if it is not registered.
  void NoteTile(const std::string& worker, TileRef tile);
  // Whether a worker on the machine was seen since `since_us`.
  bool Lives(const std::string& machine, int64_t since_us) const;
  // Of the registered workers. `since_us`: when the first of that size was registered.
  LargestWorker Largest() const;
  // The worker that was last given a task of the tile; empty if no registered worker was.
  const std::string& KeeperOf(TileRef tile) const;
  // The worker's host with its load. `cores`: as the worker reports; else the largest thread limit of its workers.
  HostLoad LoadOf(const std::string& worker) const;
  void DropJob(int job);
  // Forgets workers without a lease that were not seen since `before_us`.
  void ForgetSilentWorkers(int64_t before_us);

 private:
  std::map<TaskRef, LeaseState> leases_;
  std::map<std::string, WorkerState> workers_;
  std::map<std::string, std::set<std::string>> workers_of_host_;
  std::map<std::string, int> workers_of_client_;  // none of 0
  std::map<TileRef, std::string> keepers_;
  int64_t largest_since_us_ = 0;
};

}  // namespace tessera
