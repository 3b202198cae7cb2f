// Calls of workers: register, lease tasks, send heartbeats, report.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_usage.h"
#include "server/leases/dispatch_core.h"
#include "server/leases/lease_call.h"
#include "server/leases/work_thread.h"

namespace tessera {

struct ReportedProgress {
  std::string task;
  int attempt = 0;
  double progress = 0;
  std::string stage;
};

struct ReportedResult {
  std::vector<NamedDigest> outputs;  // already stored as blobs
  std::string stats;
  Warnings warnings;
  TaskUsage usage;
};

struct WorkerStatus {
  std::string name;
  WorkerInfo info;
  std::vector<std::string> tasks;
  double last_seen_s = 0;                  // seconds since its last call
  std::string suspended_reason = {};       // empty: not suspended
  double suspended_s = 0;                  // until the suspension ends
  std::optional<double> time_left_s = {};  // until its allocation ends; none: no limit
};

// Callbacks into server/jobs.
struct LeaseEvents {
  // Ends an attempt whose worker could not read inputs, and has lost ones recomputed. Hashes files: may take long.
  std::function<Status(const std::string& worker, const std::string& task, int attempt, const TaskFailure& failure)>
      lost_inputs;
  // Starts PlanningLoop::Advance in another thread.
  std::function<void()> advance_soon;
};

// Thread-safe. Calls of workers take a completion, `done`, so that thousands can wait without a thread each. It is
// called once, without a lock, from any thread, also after the core has stopped: with OK when the change is durable,
// with UNAVAILABLE if that takes too long (the change stays; repeat the call), or with another error and no change. It
// must be quick and not wait for the coordinator.
class Leases {
 public:
  using Done = Journal::Done;

  // `core` must outlive this.
  Leases(DispatchCore& core, LeaseEvents events);
  // Stops the core and ends all waiting calls first.
  ~Leases();

  // Returns the worker's name. RESOURCE_EXHAUSTED (Refusal::kLimit) if there are too many workers.
  StatusOr<std::string> RegisterWorker(const WorkerInfo& info);
  // Waits for a task; none after wait_s. Refusal::kUnknownWorker if the worker is not registered (any more). A later
  // call of the same worker ends the earlier one with ABORTED.
  void LeaseTask(LeaseCall call);
  // Ends the worker's waiting call if its caller has disconnected.
  void CheckWaitingCall(const std::string& worker);
  // Renews the leases. Returns the tasks that the worker must stop.
  StatusOr<std::vector<std::string>> Heartbeat(const std::string& worker, const std::vector<ReportedProgress>& tasks);

  // Refusal::kNotCurrent if the attempt is not the current one; a repeated report is OK. Statistics that are too large
  // or too deep give INVALID_ARGUMENT and end the attempt as failed. Whether the outputs are stored is not checked: the
  // reader of a missing blob reports it.
  void ReportSuccess(const std::string& worker, const std::string& task, int attempt, const ReportedResult& result,
                     Done done);
  void ReportFailure(const std::string& worker, const std::string& task, int attempt, const TaskFailure& failure,
                     Done done);
  // The worker's tasks become ready at once.
  void UnregisterWorker(const std::string& worker, Done done);
  // The same without waiting for durability and without planning.
  Status HandleSuccess(const std::string& worker, const std::string& task, int attempt, const ReportedResult& result);
  Status HandleFailure(const std::string& worker, const std::string& task, int attempt, const TaskFailure& failure);
  Status HandleUnregister(const std::string& worker);

  // Ends expired leases and stalled attempts, and removes silent workers.
  Status Expire();

  std::vector<WorkerStatus> ListWorkers() const;
  // Task and attempt of each lease of the worker. The inputs are constant while this list is.
  std::vector<std::pair<std::string, int>> LeasesOf(const std::string& worker) const;
  // SHA-256 of all inputs of the tasks leased to the worker.
  std::set<std::string> InputsOfLeases(const std::string& worker) const;

 private:
  // The outcome of one try to serve a waiting call.
  struct Try;

  // Functions named ...Locked need the core's mutex.
  Status ExpireLocked();
  StatusOr<GrantedLease> GrantLocked(TaskRef ref, const std::string& worker);
  // The lease that an earlier call with this number got, if it is current.
  StatusOr<std::optional<GrantedLease>> GrantedBeforeLocked(const std::string& worker, int64_t call);
  Try TryLocked(const LeaseCall& call);
  // Call without the mutex.
  void Answer(LeaseCall call, Try tried);
  void ServeWaiting();  // body of waiting_thread_
  // Calls `done` when `handled` is durable, and starts planning if a job needs it.
  void Finish(const Status& handled, Done done);
  // Whether a job must be planned or ended, or a ready task has a known result.
  bool AdvanceIsDueLocked();

  DispatchCore& core_;
  const LeaseEvents events_;
  const DispatchEnvironment& environment_ = core_.environment();
  const DispatchOptions& options_ = core_.options();
  std::mutex& mutex_ = core_.mutex();
  Ledger& ledger_ = core_.ledger();
  LeaseTable& leases_ = core_.lease_table();
  WaitingWorkers& waiting_ = core_.waiting();
  Journal& journal_ = core_.journal();
  int64_t last_expiry_us_ = 0;  // last check of leases; 0: never
  int next_worker_ = 1;
  WorkThread examine_thread_;  // hashes inputs that were reported lost
  std::thread waiting_thread_;
};

}  // namespace tessera
