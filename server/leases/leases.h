// Workers and their leases: a worker registers, leases tasks, sends heartbeats and reports.
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
  std::vector<NamedDigest> outputs;  // stored as blobs already
  std::string stats;
  Warnings warnings;
  TaskUsage usage;
};

struct WorkerStatus {
  std::string name;
  WorkerInfo info;
  std::vector<std::string> tasks;
  double last_seen_s = 0;             // ago
  std::string suspended_reason = {};  // empty: not suspended
  double suspended_s = 0;             // until it is given tasks again
};

// What leases need of the rooms above.
struct LeaseEvents {
  // Ends an attempt whose worker could not read inputs: those that are lost are made again. Hashes files: may take
  // long.
  std::function<Status(const std::string& worker, const std::string& task, int attempt, const TaskFailure& failure)>
      lost_inputs;
  // Has jobs planned and ended, and known results taken, by another thread.
  std::function<void()> advance_soon;
};

// Thread-safe. Calls that thousands of workers may make at once take a completion, `done`: it is called once, also
// after the core is stopped, without a lock, from any thread, with OK once the change is durable or UNAVAILABLE if that
// takes too long: the change stands, and the call may be repeated. It must be quick and not wait for the coordinator.
// On other errors nothing changed.
class Leases {
 public:
  using Done = Journal::Done;

  // `core` must outlive this.
  Leases(DispatchCore& core, LeaseEvents events);
  // Stops the core and ends all waiting calls first.
  ~Leases();

  // RESOURCE_EXHAUSTED with the limit (Refusal::kLimit) if there are too many workers.
  StatusOr<std::string> RegisterWorker(const WorkerInfo& info);
  // Waits for a task; none if there was none in time. Refusal::kUnknownWorker for a worker that is not registered (it
  // was forgotten). A worker waits once: a later call ends the earlier one with ABORTED.
  void LeaseTask(LeaseCall call);
  // If a call of the worker waits, asks it whether its caller has gone.
  void CheckWaitingCall(const std::string& worker);
  // Renews leases. Returns the tasks that the worker must stop.
  StatusOr<std::vector<std::string>> Heartbeat(const std::string& worker, const std::vector<ReportedProgress>& tasks);

  // Refusal::kNotCurrent if the attempt is not the current one. The same report again is OK. Statistics that are too
  // large or too deep are refused (INVALID_ARGUMENT) and end the attempt as failed.
  void ReportSuccess(const std::string& worker, const std::string& task, int attempt, const ReportedResult& result,
                     Done done);
  void ReportFailure(const std::string& worker, const std::string& task, int attempt, const TaskFailure& failure,
                     Done done);
  // The worker's tasks return to the queue at once.
  void UnregisterWorker(const std::string& worker, Done done);
  // The changes of these calls alone. They are not durable yet, and what follows from them is left to the caller.
  Status HandleSuccess(const std::string& worker, const std::string& task, int attempt, const ReportedResult& result);
  Status HandleFailure(const std::string& worker, const std::string& task, int attempt, const TaskFailure& failure);
  Status HandleUnregister(const std::string& worker);

  // Ends leases that expired and attempts that stall, and forgets workers that are silent.
  Status Expire();

  std::vector<WorkerStatus> ListWorkers() const;
  // Task and attempt of each of the worker's leases. While the list stays the same, so do the inputs.
  std::vector<std::pair<std::string, int>> LeasesOf(const std::string& worker) const;
  // SHA-256 of all inputs of the tasks that the worker has leases of.
  std::set<std::string> InputsOfLeases(const std::string& worker) const;

 private:
  // The outcome of one try to serve a waiting call.
  struct Look;

  // Those named ...Locked need the core's mutex.
  Status ExpireLocked();
  StatusOr<GrantedLease> GrantLocked(TaskRef ref, const std::string& worker);
  // The lease that this call was given before, if it is still current.
  StatusOr<std::optional<GrantedLease>> GrantedBeforeLocked(const std::string& worker, int64_t call);
  Look LookLocked(const LeaseCall& call);
  // Not under the mutex.
  void Answer(LeaseCall call, Look look);
  void ServeWaiting();  // the waiting thread
  // Calls `done` once `handled` is durable, and has what follows done if anything does.
  void Finish(const Status& handled, Done done);
  // Whether a job is to be planned or ended, or a known result to be taken.
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
  int64_t last_expiry_us_ = 0;  // when leases were last checked; 0: never
  int next_worker_ = 1;
  WorkThread examine_thread_;  // hashes inputs that are reported lost
  std::thread waiting_thread_;
};

}  // namespace tessera
