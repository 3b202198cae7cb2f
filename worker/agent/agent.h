// The worker's loop: register, lease a task, bring its inputs, run it, store its outputs, report; over and over.
#ifndef TESSERA_WORKER_AGENT_AGENT_H_
#define TESSERA_WORKER_AGENT_AGENT_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/rpc/channel.h"
#include "common/rpc/retry.h"
#include "worker/agent/coordinator_link.h"
#include "worker/tasks/task.h"

namespace tessera {

struct AgentOptions {
  Endpoint coordinator;
  std::string work_dir;  // cache and scratch; one process at a time
  bool use_shared_storage = true;
  int64_t cache_bytes = int64_t{20} << 30;
  double lease_wait_s = 20;  // a lease call waits that long for a task
  WorkerDescription description;
  RetryPolicy retry;            // while the coordinator is away; attempts without end whatever it says
  double storage_wait_s = 600;  // finished outputs wait that long for room to store them, then the attempt fails
};

// RunTask, or what a test puts in its place. May throw.
using TaskRunner = std::function<StatusOr<TaskOutcome>(const TaskRequest&, const TaskControl&)>;

class Agent {
 public:
  // FAILED_PRECONDITION if another process works in the folder; errors of the endpoint's files.
  static StatusOr<std::unique_ptr<Agent>> Create(const AgentOptions& options, TaskRunner runner);
  ~Agent();

  // Works until StopLeasing or Drain. A coordinator that is away, restarted or has forgotten this worker is waited for
  // without end; the task at hand goes on meanwhile and is reported when it is back. An error only if the coordinator
  // refuses the worker for good (other version of the algorithms).
  Status Run();

  // Takes no other task: Run ends once the one at hand was reported, at once if there is none. Any thread; not a signal
  // handler.
  void StopLeasing();

  // Gives the running task up (reported as aborted), unregisters and ends Run. Any thread; not a signal handler.
  void Drain();

 private:
  class Impl;
  explicit Agent(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_AGENT_AGENT_H_
