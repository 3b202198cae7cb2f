// Calls of workers that wait for a task, and which of them is woken.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "server/leases/lease_call.h"

namespace tessera {

// At most one call per worker; a call holds no thread. Each ready task wakes one call. A worker that leaves a task to
// others wakes the next call, until all have been offered the ready tasks. The owner takes out calls that were woken or
// are due, and adds those again that continue to wait. Not thread-safe.
class WaitingWorkers {
 public:
  using Time = LeaseCall::Time;

  // The call waits until it is woken, or `due`. No other call of its worker may wait.
  void Add(LeaseCall call, Time due);
  // There are ready tasks that the waiting calls have not been offered.
  void ReadyHasGrown() { ++generation_; }
  // False if this worker does not wait, or is woken already.
  bool Wake(const std::string& worker);
  // Wakes the call that has waited longest, unless it was offered the ready tasks already. False if all were.
  bool WakeNext();
  void WakeAll();
  // When TakeDue will return a call: in the past if now; none if no call waits.
  std::optional<Time> NextDue() const;
  // A call that was woken or is due.
  std::optional<LeaseCall> TakeDue(Time now);
  std::optional<LeaseCall> Take(const std::string& worker);

  // Sleeps until TakeDue has a call, and returns the time to pass to it; none once End was called and no worker waits.
  // `lock`: of the mutex that guards this. One thread may call it.
  std::optional<Time> AwaitDue(std::unique_lock<std::mutex>& lock);
  // Ends AwaitDue's sleep if a call is due before that would end. To be called after all else that may make one due.
  void Notify();
  void End();

 private:
  struct Waiter {
    LeaseCall call;
    int64_t seen = 0;  // generation
    Time due = {};
    bool is_woken = false;
    std::list<Waiter*>::iterator place = {};
  };
  void WakeOne(Waiter& waiter);

  std::condition_variable due_changed_;
  Time sleeps_until_ = Time::min();  // AwaitDue; min: it does not sleep
  bool ends_ = false;
  int64_t generation_ = 0;
  std::map<std::string, Waiter> of_worker_;
  std::list<Waiter*> waiting_;                 // not woken yet, the longest first: so ascending in `seen`
  std::list<Waiter*> woken_;                   // the first woken first
  std::set<std::pair<Time, Waiter*>> by_due_;  // not woken
};

}  // namespace tessera
