// The worker's main loop: register, lease a task, fetch its inputs, run it, store its outputs, report, repeat.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/rpc/channel.h"
#include "common/base/retry/retry.h"
#include "worker/agent/coordinator_link.h"
#include "worker/tasks/task.h"

namespace tessera {

struct AgentOptions {
  Endpoint coordinator;
  std::string work_dir;  // cache and scratch; used by one process at a time
  bool use_shared_storage = true;
  int64_t cache_bytes = int64_t{20} << 30;
  double lease_wait_s = 20;  // how long a lease call waits for a task
  double idle_s = 0;         // Run ends after this time without a task; 0: never
  // Run ends kEndMargin_s before the worker's allocation (description.time_left_s, from Create on) if it has no task.
  WorkerDescription description;
  RetryPolicy retry;            // while the coordinator is unreachable; the number of attempts is always unlimited
  double storage_wait_s = 600;  // how long finished outputs wait for storage space before the attempt fails
};

// RunTask, or a replacement in tests. May throw.
using TaskRunner = std::function<StatusOr<TaskOutcome>(const TaskRequest&, const TaskControl&)>;

class Agent {
 public:
  // FAILED_PRECONDITION if another process uses the folder; errors of the endpoint's files.
  static StatusOr<std::unique_ptr<Agent>> Create(const AgentOptions& options, TaskRunner runner);
  ~Agent();

  // Runs until StopLeasing or Drain, or until there was no task for AgentOptions::idle_s or until the end of
  // the allocation is near. If the coordinator is
  // unreachable, has restarted or no longer has this worker, retries without limit; the current task continues and is
  // reported later. Returns an error only if the coordinator rejects the worker permanently (different version of the
  // algorithms), and UNAVAILABLE if none answered for idle_s.
  Status Run();

  // Leases no further task: Run returns after the current task is reported, or at once if there is none. Thread-safe;
  // not for signal handlers.
  void StopLeasing();

  // Aborts the current task (reported as preempted), unregisters and ends Run. Thread-safe; not for signal handlers.
  void Drain();

 private:
  class Impl;
  explicit Agent(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
