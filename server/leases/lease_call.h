// A worker's call for a task, and what it is given.
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
  std::string path;  // where the coordinator has it
};

// A task given to a worker.
struct GrantedLease {
  std::string task;
  int attempt = 0;  // the fencing token
  int threads = 0;  // that the task may use
  PlannedTask plan;
  std::vector<LeasedInput> inputs;
  std::string key;
};

// None: there was no task for it.
using LeaseAnswer = StatusOr<std::optional<GrantedLease>>;

struct LeaseCall {
  using Time = std::chrono::steady_clock::time_point;

  std::string worker;
  double wait_s = 0;  // longest wait for a task
  // Above 0: the number of the call. A repeated call of the same number is given the same lease again.
  int64_t call = 0;
  // Whether the caller has gone. Must be quick and not call back; not called after `done`. May be
  // empty.
  std::function<bool()> gone = {};
  // Called once, without a lock, from any thread, also from the one that calls.
  std::function<void(LeaseAnswer answer)> done = {};
  bool comes_with_report = false;  // the call came with a report: it does not wait, and is placed like a waiting one
  Time asked = {}, until = {};     // set by Leases
};

}  // namespace tessera
