#include "server/dispatch/lease_table.h"

#include <algorithm>

namespace tessera {
namespace {

constexpr size_t kRecentTiles = 8;

}  // namespace

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

bool LeaseTable::Lives(const std::string& machine, int64_t since_us) const {
  return !machine.empty() && std::any_of(workers_.begin(), workers_.end(), [&](const auto& entry) {
    return entry.second.info.machine == machine && entry.second.last_seen_us >= since_us;
  });
}

void LeaseTable::NoteTile(const std::string& worker, TileRef tile) {
  const auto found = workers_.find(worker);
  if (found == workers_.end() || tile.tile < 0) return;
  std::vector<TileRef>& recent = found->second.recent_tiles;
  recent.erase(std::remove(recent.begin(), recent.end(), tile), recent.end());
  recent.insert(recent.begin(), tile);
  if (recent.size() > kRecentTiles) recent.pop_back();
  keepers_[tile] = worker;
}

const std::string& LeaseTable::KeeperOf(TileRef tile) const {
  static const std::string kNobody;
  const auto found = keepers_.find(tile);
  return found == keepers_.end() || !workers_.contains(found->second) ? kNobody : found->second;
}

HostLoad LeaseTable::LoadOf(const std::string& worker) const {
  HostLoad load;
  const auto found = workers_.find(worker);
  if (found == workers_.end()) return load;
  const std::string& host = found->second.info.host;
  int most_threads = 0;
  for (const auto& [name, other] : workers_) {
    if (other.info.host != host) continue;
    ++load.workers;
    load.cores = std::max(load.cores, other.info.cores);
    most_threads = std::max(most_threads, other.info.threads);
  }
  if (load.cores == 0) load.cores = most_threads;
  for (const auto& [ref, lease] : leases_) {
    const auto holder = workers_.find(lease.worker);
    if (holder != workers_.end() && holder->second.info.host == host) ++load.running;
  }
  return load;
}

void LeaseTable::DropJob(int job) {
  std::erase_if(keepers_, [job](const auto& entry) { return entry.first.job == job; });
  std::erase_if(leases_, [job](const auto& entry) { return entry.first.job == job; });
}

void LeaseTable::ForgetSilentWorkers(int64_t before_us) {
  std::erase_if(workers_, [&](const auto& entry) {
    return entry.second.last_seen_us < before_us && HeldBy(entry.first).empty();
  });
}

}  // namespace tessera
