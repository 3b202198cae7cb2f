// Serves the coordinator's metrics to Prometheus.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "common/s3/s3_client.h"
#include "server/metrics/dispatch_snapshot.h"
#include "server/metrics/http_counts.h"
#include "server/metrics/rpc_counts.h"

namespace tessera {

// Called at every scrape, from any thread.
struct MetricSources {
  std::function<DispatchSnapshot()> dispatch;  // empty: the coordinator stands by, and has few metrics
  std::function<std::optional<int64_t>()> free_bytes;  // of the disk that holds the results
  const RpcCounts* rpcs = nullptr;
  std::function<std::map<std::string, S3Counts>()> store = {};  // requests to the S3 store by method; empty: none
  const HttpCounts* http = nullptr;                             // null: no page is served
};

// Serves all metrics in Prometheus' text format at http://ADDRESS/metrics, without authentication.
class MetricsServer {
 public:
  // `address`: "host:port"; port 0: any free port. INVALID_ARGUMENT if malformed, UNAVAILABLE if it cannot listen
  // there.
  static StatusOr<std::unique_ptr<MetricsServer>> Start(const std::string& address, MetricSources sources);
  ~MetricsServer();
  // The address with the bound port.
  const std::string& address() const;
  // Serves other metrics from now on. The earlier sources are not used afterwards.
  void Replace(MetricSources sources);

 private:
  struct Impl;
  explicit MetricsServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera
