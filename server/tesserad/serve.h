// Serving: from the wait for the state to the last answer.
#pragma once

#include <signal.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/auth/client_limits.h"
#include "server/grpc/coordinator_server.h"
#include "server/leases/dispatch_core.h"
#include "server/tesserad/open_blobs.h"

namespace tessera {

// What the options of tesserad say about serving; their help is in tesserad.cc.
struct ServeOptions {
  std::string data;
  std::string state;  // empty: in `data`
  BlobFlags blobs;
  bool accept_blobs = false;
  ListenOptions listen;
  std::string port_file, token_file;
  std::vector<std::string> scene_roots;  // folders and s3://BUCKET/PREFIX
  double lease_s = DispatchOptions().lease_s, stall_s = DispatchOptions().stall_s;
  double keep_days = 0, blob_gib = 0;
  std::optional<double> drain_s;  // unset: kDrain_s, or kHandOver_s if a standby may take over
  JobLimits jobs;
  WorkerLimits workers;
  ClientLimitOptions limits;
  double upload_gib = static_cast<double>(ClientLimitOptions().upload_bytes) / (int64_t{1} << 30);
  bool no_shared_storage = false;
  std::string version;  // of the program
};

inline constexpr double kDrain_s = 5, kHandOver_s = 1;

// Waits for the state, listening on nothing but the address of the metrics, then serves until one of `stop_signals`
// arrives. All threads must have blocked these signals.
Status Serve(const ServeOptions& options, const sigset_t& stop_signals);

}  // namespace tessera
