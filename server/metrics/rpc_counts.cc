#include "server/metrics/rpc_counts.h"

#include <algorithm>

#include "absl/status/status.h"

namespace tessera {

RpcCounts::RpcCounts(const std::vector<std::string>& methods) : names_(methods) {
  for (const std::string& name : names_) {
    auto& added = methods_.emplace_back(std::make_unique<OfMethod>());
    // Drop the package name.
    const size_t service = name.find_last_of('.', name.rfind('/'));
    added->name = service == std::string::npos ? name : name.substr(service + 1);
    of_name_[name] = added.get();
  }
  methods_.push_back(std::make_unique<OfMethod>());
  methods_.back()->name = "other";
}

RpcCounts::OfMethod& RpcCounts::Of(std::string_view method) {
  const auto found = of_name_.find(method);
  return found == of_name_.end() ? *methods_.back() : *found->second;
}

void RpcCounts::Count(OfMethod& method, int code, double seconds) {
  method.codes[code >= 0 && code < kCodes - 1 ? code : kCodes - 1].fetch_add(1, std::memory_order_relaxed);
  const auto bucket = std::lower_bound(kBounds_s.begin(), kBounds_s.end(), seconds) - kBounds_s.begin();
  method.buckets[bucket].fetch_add(1, std::memory_order_relaxed);
  method.seconds.fetch_add(seconds, std::memory_order_relaxed);
}

std::string RpcCounts::CodeName(int code) {
  return code >= 0 && code < kCodes - 1 ? absl::StatusCodeToString(static_cast<absl::StatusCode>(code)) : "other";
}

}  // namespace tessera
