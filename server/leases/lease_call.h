// A worker's request for a task, and the lease granted to it.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/storage/hash.h"
#include "server/plan/planned_task.h"

namespace tessera {

struct LeasedInput {
  NamedDigest file;
  std::string path;  // local path on the coordinator, or empty
};

// A task given to a worker.
struct GrantedLease {
  std::string task;
  int attempt = 0;  // the fencing token
  int threads = 0;  // thread limit of the task
  PlannedTask plan;
  std::vector<LeasedInput> inputs;
  std::string key;
};

// None: no task for this worker.
using LeaseAnswer = StatusOr<std::optional<GrantedLease>>;

struct LeaseCall {
  using Time = std::chrono::steady_clock::time_point;

  std::string worker;
  double wait_s = 0;  // longest wait for a task
  // Number of the call if above 0. Repeating a number returns the same lease.
  int64_t call = 0;
  // Whether the caller has disconnected. Must be quick, not call the coordinator. Not called after `done`. May be
  // empty.
  std::function<bool()> gone = {};
  // Called once, without a lock, from any thread, including the calling one.
  std::function<void(LeaseAnswer answer)> done = {};
  bool comes_with_report = false;  // part of a report: does not wait, but leaves tiles to their workers
  Time asked = {}, until = {};     // set by Leases
};

}  // namespace tessera
