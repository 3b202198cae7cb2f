// What Prometheus reads of a coordinator.
#ifndef TESSERA_SERVER_METRICS_METRICS_SERVER_H_
#define TESSERA_SERVER_METRICS_METRICS_SERVER_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "server/metrics/dispatch_snapshot.h"
#include "server/metrics/rpc_counts.h"

namespace tessera {

// Asked at every reading, from any thread.
struct MetricSources {
  std::function<DispatchSnapshot()> dispatch;
  std::function<std::optional<int64_t>()> free_bytes;  // of the disk with the results
  const RpcCounts* rpcs = nullptr;
};

// All metrics in Prometheus' text format. Labels are kinds, classes, states, methods and codes alone, of which there
// are a fixed number; what a user named is in none. Every family is there from the start.
std::string MetricsText(const MetricSources& sources);

// Serves MetricsText at http://ADDRESS/metrics, to anybody who can reach it.
class MetricsServer {
 public:
  // `address`: "host:port"; port 0: any. INVALID_ARGUMENT for another form, UNAVAILABLE if that is not possible.
  static StatusOr<std::unique_ptr<MetricsServer>> Start(const std::string& address, MetricSources sources);
  ~MetricsServer();
  // With the port that was bound.
  const std::string& address() const;

 private:
  struct Impl;
  explicit MetricsServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_METRICS_METRICS_SERVER_H_
