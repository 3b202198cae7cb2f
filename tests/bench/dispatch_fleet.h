// What a coordinator bears: workers without work over gRPC on loopback.
#pragma once

#include <string>

#include "common/base/status.h"

namespace tessera {

// Of RUSAGE_SELF or RUSAGE_CHILDREN, processor time in seconds.
double CpuSeconds(int who);

struct FleetArguments {
  int tasks = 0;
  int workers = 1000;
  double work_s = 0;  // that a worker takes for a task
  bool tls = false;   // with TLS and tokens
  int pages = 0;      // of the job, in browsers that are simulated by a process of their own (page_clients.h)
};

// Runs a job of so many tasks, each with parameters of 400 bytes and statistics of 300, in chains as long as tiles have
// steps, and prints tasks a second, latencies of leases and heartbeats, and the coordinator's memory a task. `folder`:
// where state and blobs lie, and stay. `state`: postgresql://..., an empty state, in place of the folder's; or empty.
// Returns tasks a second.
StatusOr<double> RunFleet(const FleetArguments& arguments, const std::string& folder, const std::string& state);

// Opens the state of such a run and prints how long that takes.
Status ReopenFleet(const std::string& folder);

}  // namespace tessera
