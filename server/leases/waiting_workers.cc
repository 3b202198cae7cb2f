#include "server/leases/waiting_workers.h"

namespace tessera {

void WaitingWorkers::Add(LeaseCall call, Time due) {
  Waiter& waiter = of_worker_[call.worker];
  waiter.call = std::move(call);
  waiter.seen = generation_;
  waiter.due = due;
  waiter.place = waiting_.insert(waiting_.end(), &waiter);
  by_due_.insert({due, &waiter});
}

void WaitingWorkers::WakeOne(Waiter& waiter) {
  waiter.is_woken = true;
  woken_.splice(woken_.end(), waiting_, waiter.place);
  by_due_.erase({waiter.due, &waiter});
}

bool WaitingWorkers::Wake(const std::string& worker) {
  const auto found = of_worker_.find(worker);
  if (found == of_worker_.end() || found->second.is_woken) return false;
  WakeOne(found->second);
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

std::optional<WaitingWorkers::Time> WaitingWorkers::NextDue() const {
  if (!woken_.empty()) return Time::min();
  return by_due_.empty() ? std::nullopt : std::optional(by_due_.begin()->first);
}

std::optional<LeaseCall> WaitingWorkers::TakeDue(Time now) {
  if (!woken_.empty()) return Take(woken_.front()->call.worker);
  if (by_due_.empty() || by_due_.begin()->first > now) return std::nullopt;
  return Take(by_due_.begin()->second->call.worker);
}

std::optional<LeaseCall> WaitingWorkers::Take(const std::string& worker) {
  const auto found = of_worker_.find(worker);
  if (found == of_worker_.end()) return std::nullopt;
  Waiter& waiter = found->second;
  if (!waiter.is_woken) by_due_.erase({waiter.due, &waiter});
  (waiter.is_woken ? woken_ : waiting_).erase(waiter.place);
  LeaseCall call = std::move(waiter.call);
  of_worker_.erase(found);
  return call;
}

std::optional<WaitingWorkers::Time> WaitingWorkers::AwaitDue(std::unique_lock<std::mutex>& lock) {
  while (true) {
    const Time now = std::chrono::steady_clock::now();
    const std::optional<Time> due = NextDue();
    if (!due && ends_) return std::nullopt;
    if (due && *due <= now) return now;
    sleeps_until_ = due.value_or(Time::max());
    due ? static_cast<void>(due_changed_.wait_until(lock, *due)) : due_changed_.wait(lock);
    sleeps_until_ = Time::min();
  }
}

void WaitingWorkers::Notify() {
  const std::optional<Time> due = NextDue();
  if (due && *due < sleeps_until_) due_changed_.notify_one();
}

void WaitingWorkers::End() {
  ends_ = true;
  due_changed_.notify_one();
}

}  // namespace tessera
