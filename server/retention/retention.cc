#include "server/retention/retention.h"

#include <utility>

namespace tessera {

std::vector<int> Retention::Expired(const std::vector<KeptThing>& things, int64_t unix_us, int64_t monotonic_us) {
  std::vector<int> expired;
  std::map<std::string, int64_t> overdue;
  for (int i = 0; i < static_cast<int>(things.size()); ++i) {
    const KeptThing& thing = things[i];
    const double age_s = static_cast<double>(unix_us - thing.since_us) / 1e6;
    if (keep_s_ <= 0 || thing.since_us <= 0 || age_s <= keep_s_) continue;
    const auto known = overdue_since_us_.find(thing.name);
    const int64_t since_us = known == overdue_since_us_.end() ? monotonic_us : known->second;
    overdue[thing.name] = since_us;
    if (static_cast<double>(monotonic_us - since_us) >= kConfirm_s * 1e6) expired.push_back(i);
  }
  overdue_since_us_ = std::move(overdue);
  return expired;
}

}  // namespace tessera
