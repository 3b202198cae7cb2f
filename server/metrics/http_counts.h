// Counts requests of the page's HTTP server by route, class of status and duration.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "server/metrics/rpc_counts.h"

namespace tessera {

// Thread-safe and lock-free.
class HttpCounts {
 public:
  static constexpr int kClasses = 5;  // 1xx to 5xx
  static constexpr auto kBounds_s = RpcCounts::kBounds_s;

  struct OfRoute {
    std::string name;                                                     // "GET /api/v1/jobs/{job}"; last: "other"
    std::array<std::atomic<int64_t>, kClasses> classes = {};              // requests
    std::array<std::atomic<int64_t>, kBounds_s.size() + 1> buckets = {};  // requests by seconds, not cumulative
    std::atomic<double> seconds = 0;
  };

  explicit HttpCounts(const std::vector<std::string>& routes);
  // `route`: index in the list; any other number: no route.
  void Count(size_t route, int status, double seconds);
  const std::vector<std::unique_ptr<OfRoute>>& routes() const { return routes_; }

 private:
  std::vector<std::unique_ptr<OfRoute>> routes_;
};

}  // namespace tessera
