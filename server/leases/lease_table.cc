#include "server/leases/lease_table.h"

#include <algorithm>
#include <utility>

#include "common/job/end_margin.h"

namespace tessera {
namespace {

constexpr size_t kRecentTiles = 8;

const std::string& MachineOf(const WorkerInfo& info) { return info.machine.empty() ? info.host : info.machine; }

}  // namespace

double TimeLeft_s(const WorkerState& worker, int64_t now_us) {
  if (worker.ends_us == 0) return std::numeric_limits<double>::infinity();
  return static_cast<double>(worker.ends_us - now_us) / 1e6;
}

bool HasTime(const WorkerState& worker, double core_s, int threads, int64_t now_us) {
  return core_s / std::max(1, threads) + kEndMargin_s <= TimeLeft_s(worker, now_us);
}

const LeaseState* LeaseTable::Find(TaskRef ref) const {
  const auto it = leases_.find(ref);
  return it == leases_.end() ? nullptr : &it->second;
}

LeaseState* LeaseTable::FindCurrent(TaskRef ref, const std::string& worker, int attempt) {
  const auto it = leases_.find(ref);
  if (it == leases_.end() || it->second.worker != worker || it->second.attempt != attempt) return nullptr;
  return &it->second;
}

void LeaseTable::ShiftTimes(int64_t time_us, int64_t now_us, int64_t lease_us) {
  for (auto& [ref, lease] : leases_) {
    if (lease.expires_us == kNotSent_us) continue;
    lease.expires_us = std::min(lease.expires_us + time_us, now_us + lease_us);
    lease.progressed_us = std::min(lease.progressed_us + time_us, now_us);
  }
  for (auto& [name, worker] : workers_) worker.last_seen_us = std::min(worker.last_seen_us + time_us, now_us);
}

std::vector<TaskRef> LeaseTable::Expired(int64_t now_us) const {
  std::vector<TaskRef> expired;
  for (const auto& [ref, lease] : leases_) {
    if (lease.expires_us < now_us) expired.push_back(ref);
  }
  return expired;
}

std::vector<TaskRef> LeaseTable::OfJob(int job) const {
  std::vector<TaskRef> tasks;
  for (auto it = leases_.lower_bound({job, 0}); it != leases_.end() && it->first.job == job; ++it) {
    tasks.push_back(it->first);
  }
  return tasks;
}

int LeaseTable::WorkersOf(const std::string& client) const {
  const auto found = workers_of_client_.find(client);
  return found == workers_of_client_.end() ? 0 : found->second;
}

WorkerState* LeaseTable::FindWorker(const std::string& worker) {
  const auto found = workers_.find(worker);
  return found == workers_.end() ? nullptr : &found->second;
}

void LeaseTable::AddWorker(const std::string& worker, const WorkerInfo& info, int64_t now_us) {
  if (info.memory_bytes > Largest().memory_bytes) largest_since_us_ = now_us;
  WorkerState& added = workers_[worker] = {info, now_us};
  if (info.time_left_s > 0) added.ends_us = now_us + Micros(info.time_left_s);
  workers_of_machine_[MachineOf(info)].insert(worker);
  ++workers_of_client_[info.client];
}

void LeaseTable::RemoveWorker(const std::string& worker) {
  const auto found = workers_.find(worker);
  if (found == workers_.end()) return;
  const auto machine = workers_of_machine_.find(MachineOf(found->second.info));
  machine->second.erase(worker);
  if (machine->second.empty()) workers_of_machine_.erase(machine);
  const auto client = workers_of_client_.find(found->second.info.client);
  if (--client->second == 0) workers_of_client_.erase(client);
  workers_.erase(found);
}

LeaseState& LeaseTable::Grant(TaskRef ref, LeaseState lease) {
  Release(ref);
  if (WorkerState* const holder = FindWorker(lease.worker)) {
    holder->tasks.insert(ref);
    holder->short_of_time_since_us.reset();
  }
  return leases_[ref] = std::move(lease);
}

void LeaseTable::Release(TaskRef ref) {
  const auto found = leases_.find(ref);
  if (found == leases_.end()) return;
  if (WorkerState* const holder = FindWorker(found->second.worker)) holder->tasks.erase(ref);
  leases_.erase(found);
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
  last_workers_[tile] = worker;
}

LargestWorker LeaseTable::Largest() const {
  LargestWorker largest = {0, largest_since_us_};
  for (const auto& [name, worker] : workers_) {
    largest.memory_bytes = std::max(largest.memory_bytes, worker.info.memory_bytes);
  }
  return largest;
}

const std::string& LeaseTable::LastWorkerOf(TileRef tile) const {
  static const std::string kNothing;
  const auto found = last_workers_.find(tile);
  return found == last_workers_.end() || !workers_.contains(found->second) ? kNothing : found->second;
}

MachineLoad LeaseTable::LoadOf(const std::string& worker) const {
  MachineLoad load;
  const auto found = workers_.find(worker);
  if (found == workers_.end()) return load;
  int most_threads = 0;
  for (const std::string& name : workers_of_machine_.at(MachineOf(found->second.info))) {
    const WorkerState& other = workers_.at(name);
    ++load.workers;
    load.cores = std::max(load.cores, other.info.cores);
    load.running += static_cast<int>(other.tasks.size());
    most_threads = std::max(most_threads, other.info.threads);
  }
  if (load.cores == 0) load.cores = most_threads;
  return load;
}

void LeaseTable::DropJob(int job) {
  std::erase_if(last_workers_, [job](const auto& entry) { return entry.first.job == job; });
  for (const TaskRef ref : OfJob(job)) Release(ref);
}

void LeaseTable::ForgetSilentWorkers(int64_t before_us) {
  std::vector<std::string> silent;
  for (const auto& [name, worker] : workers_) {
    if (worker.last_seen_us < before_us && worker.tasks.empty()) silent.push_back(name);
  }
  for (const std::string& name : silent) RemoveWorker(name);
}

}  // namespace tessera
