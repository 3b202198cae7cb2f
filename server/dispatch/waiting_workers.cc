#include "server/dispatch/waiting_workers.h"

namespace tessera {

void WaitingWorkers::Wait(std::unique_lock<std::mutex>& lock, const std::string& worker,
                          std::chrono::steady_clock::time_point until) {
  Waiter waiter;
  waiter.seen = generation_;
  waiter.place = waiting_.insert(waiting_.end(), &waiter);
  waiter.of_worker = of_worker_.emplace(worker, &waiter);
  waiter.woken.wait_until(lock, until, [&] { return waiter.is_woken; });
  if (waiter.is_woken) return;
  waiting_.erase(waiter.place);
  of_worker_.erase(waiter.of_worker);
}

void WaitingWorkers::WakeOne(Waiter& waiter) {
  waiter.is_woken = true;
  waiting_.erase(waiter.place);
  of_worker_.erase(waiter.of_worker);
  waiter.woken.notify_one();
}

bool WaitingWorkers::Wake(const std::string& worker) {
  const auto found = of_worker_.find(worker);
  if (found == of_worker_.end()) return false;
  WakeOne(*found->second);
  return true;
}

bool WaitingWorkers::WakeNext() {
  if (waiting_.empty() || waiting_.front()->seen == generation_) return false;
  WakeOne(*waiting_.front());
  return true;
}

void WaitingWorkers::WakeAll() {
  while (!waiting_.empty()) WakeOne(*waiting_.front());
}

}  // namespace tessera
