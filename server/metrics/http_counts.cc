#include "server/metrics/http_counts.h"

#include <algorithm>

namespace tessera {

HttpCounts::HttpCounts(const std::vector<std::string>& routes) {
  for (const std::string& name : routes) {
    routes_.push_back(std::make_unique<OfRoute>());
    routes_.back()->name = name;
  }
  routes_.push_back(std::make_unique<OfRoute>());
  routes_.back()->name = "other";
}

void HttpCounts::Count(size_t route, int status, double seconds) {
  OfRoute& counted = *routes_[std::min(route, routes_.size() - 1)];
  counted.classes[std::clamp(status / 100, 1, kClasses) - 1].fetch_add(1, std::memory_order_relaxed);
  const auto bucket = std::lower_bound(kBounds_s.begin(), kBounds_s.end(), seconds) - kBounds_s.begin();
  counted.buckets[bucket].fetch_add(1, std::memory_order_relaxed);
  counted.seconds.fetch_add(seconds, std::memory_order_relaxed);
}

}  // namespace tessera
