// The worker's side of the Workers service, in the project's own types.
#ifndef TESSERA_WORKER_AGENT_COORDINATOR_LINK_H_
#define TESSERA_WORKER_AGENT_COORDINATOR_LINK_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_usage.h"
#include "common/storage/hash.h"
#include "worker/agent/failure.h"

namespace grpc {
class Channel;
}  // namespace grpc

namespace tessera {

// What a worker tells of itself.
struct WorkerDescription {
  std::string host;
  int pid = 0;
  int threads = 0;  // that its tasks may use at most
  int64_t memory_bytes = 0;
  std::string version;  // of the algorithms
  int cores = 0;        // of the host; 0: not known
  std::string machine;  // host and boot
};

// What the coordinator answers.
struct Registration {
  std::string worker;  // "workers/W"
  std::string secret;  // to be shown with every later call
  double lease_s = 0;
  double heartbeat_s = 0;
  // A worker that reads `shared_probe_content` at `shared_probe_path` may write blobs to `shared_blob_dir`; empty:
  // none.
  std::string shared_blob_dir;
  std::string shared_probe_path;
  std::string shared_probe_content;
};

struct TaskInput {
  std::string name;  // relative to the task's input folder
  Digest digest;
  std::string shared_path;  // where a worker with access may read it; empty: blob service only
};

// A task under a lease.
struct LeasedTask {
  std::string task;  // "jobs/J/tasks/T"
  int attempt = 0;   // fencing token
  std::string kind;
  std::string title;
  int tile = -1;  // -1: the whole job
  std::string parameters;
  std::vector<TaskInput> inputs;
  int threads = 0;  // that it may use; 0: as many as the worker has
};

struct AttemptProgress {
  std::string task;
  int attempt = 0;
  double fraction = 0;
  std::string stage;
};

// How an attempt ended.
struct AttemptReport {
  std::string task;
  int attempt = 0;
  bool succeeded = false;
  std::vector<NamedDigest> outputs;  // of a success; stored as blobs already
  std::string stats;
  Warnings warnings;
  TaskUsage usage;
  Failure failure;  // of one that did not succeed
};

// Each call is one attempt with a deadline; errors are the coordinator's own (RefusalOf), or UNAVAILABLE and
// DEADLINE_EXCEEDED of the way there. Thread-safe.
class CoordinatorLink {
 public:
  explicit CoordinatorLink(std::shared_ptr<grpc::Channel> channel);
  ~CoordinatorLink();

  StatusOr<Registration> Register(const WorkerDescription& description);
  // Waits up to `wait_s` for a task; nothing if there was none. `call`: above 0, another one once a call was answered.
  StatusOr<std::optional<LeasedTask>> Lease(const std::string& worker, double wait_s, int64_t call);
  // Ends a running Lease call, and every later one at once, with CANCELLED.
  void StopLeasing();
  // The tasks to stop, of those named.
  StatusOr<std::vector<std::string>> Heartbeat(const std::string& worker, const std::vector<AttemptProgress>& running);
  // Refusal::kNotCurrent: the attempt is no longer the current one. With a success the next task comes back, if there
  // is one for the worker now, and `lease_call` is above 0, as Lease's.
  StatusOr<std::optional<LeasedTask>> Report(const std::string& worker, const AttemptReport& report,
                                             int64_t lease_call);
  Status Unregister(const std::string& worker);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_AGENT_COORDINATOR_LINK_H_
