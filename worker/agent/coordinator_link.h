// Client of the Workers service in the project's own types.
#pragma once

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

// What a worker sends at registration.
struct WorkerDescription {
  std::string host;
  int pid = 0;
  int threads = 0;  // limit for its tasks
  int64_t memory_bytes = 0;
  std::string version;          // of the algorithms
  int cores = 0;                // of the host; 0: unknown
  std::string machine = {};     // host name, boot id and allocation
  std::string allocation = {};  // the scheduler's job; empty: none
  double time_left_s = 0;       // until the allocation ends; 0: no limit
};

// The coordinator's answer to Register.
struct Registration {
  std::string worker;  // "workers/W"
  std::string secret;  // sent with every later call
  double lease_s = 0;
  double heartbeat_s = 0;
  // A worker that reads `shared_probe_content` from `shared_probe_path` may read and write blobs in `shared_blob_dir`;
  // empty: no shared storage.
  std::string shared_blob_dir;
  std::string shared_probe_path;
  std::string shared_probe_content;
};

struct TaskInput {
  std::string name;  // relative to the task's input folder
  Digest digest;
  std::string shared_path;  // path on shared storage; empty: use the blob service
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
  int threads = 0;  // limit for this task; 0: the worker's
};

struct AttemptProgress {
  std::string task;
  int attempt = 0;
  double fraction = 0;
  std::string stage;
};

// Result of an attempt.
struct AttemptReport {
  std::string task;
  int attempt = 0;
  bool succeeded = false;
  std::vector<NamedDigest> outputs;  // if succeeded; already stored as blobs
  std::string stats;
  Warnings warnings;
  TaskUsage usage;
  Failure failure;  // if not succeeded
};

// Each call is a single RPC with a deadline. Errors are the coordinator's (RefusalOf), or UNAVAILABLE and
// DEADLINE_EXCEEDED of the connection. Thread-safe.
class CoordinatorLink {
 public:
  explicit CoordinatorLink(std::shared_ptr<grpc::Channel> channel);
  ~CoordinatorLink();

  StatusOr<Registration> Register(const WorkerDescription& description);
  // Waits up to `wait_s` for a task; nullopt if there is none. `call`: > 0, a new number after every answered call,
  // so that a repeated call returns the same lease.
  StatusOr<std::optional<LeasedTask>> Lease(const std::string& worker, double wait_s, int64_t call);
  // Cancels a running Lease call and all later ones (CANCELLED).
  void StopLeasing();
  // Sends progress. Returns the tasks of `running` that must stop.
  StatusOr<std::vector<std::string>> Heartbeat(const std::string& worker, const std::vector<AttemptProgress>& running);
  // Reports an attempt. Refusal::kNotCurrent: the attempt is no longer the current one. A success may return the next
  // lease, if `lease_call` > 0 (as in Lease).
  StatusOr<std::optional<LeasedTask>> Report(const std::string& worker, const AttemptReport& report,
                                             int64_t lease_call);
  Status Unregister(const std::string& worker);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
