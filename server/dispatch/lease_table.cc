#include "server/dispatch/lease_table.h"

namespace tessera {

const LeaseState* LeaseTable::Find(TaskRef ref) const {
  const auto it = leases_.find(ref);
  return it == leases_.end() ? nullptr : &it->second;
}

LeaseState* LeaseTable::FindCurrent(TaskRef ref, const std::string& worker, int attempt) {
  const auto it = leases_.find(ref);
  if (it == leases_.end() || it->second.worker != worker || it->second.attempt != attempt) return nullptr;
  return &it->second;
}

std::vector<TaskRef> LeaseTable::Expired(int64_t now_us) const {
  std::vector<TaskRef> expired;
  for (const auto& [ref, lease] : leases_) {
    if (lease.expires_us < now_us) expired.push_back(ref);
  }
  return expired;
}

std::vector<TaskRef> LeaseTable::HeldBy(const std::string& worker) const {
  std::vector<TaskRef> held;
  for (const auto& [ref, lease] : leases_) {
    if (lease.worker == worker) held.push_back(ref);
  }
  return held;
}

void LeaseTable::DropJob(int job) {
  std::erase_if(leases_, [job](const auto& entry) { return entry.first.job == job; });
}

void LeaseTable::ForgetSilentWorkers(int64_t before_us) {
  std::erase_if(workers_, [&](const auto& entry) {
    return entry.second.last_seen_us < before_us && HeldBy(entry.first).empty();
  });
}

}  // namespace tessera
