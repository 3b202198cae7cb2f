// The calls of workers that wait for a task, and the order in which they are woken.
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

// At most one call per worker; a call holds no thread. Each ready task wakes one call. A worker that does not take the
// task wakes the next call, until all have tried. The owner takes out woken and due calls, and adds those again that
// continue to wait. Not thread-safe.
class WaitingWorkers {
 public:
  using Time = LeaseCall::Time;

  // The call waits until woken or `due`. Precondition: no other call of its worker waits.
  void Add(LeaseCall call, Time due);
  // Call for new ready tasks: WakeNext may wake every waiting call once more.
  void ReadyHasGrown() { ++generation_; }
  // False if the worker does not wait or is already woken.
  bool Wake(const std::string& worker);
  // Wakes the longest waiting call that has not tried the ready tasks. False if all have.
  bool WakeNext();
  void WakeAll();
  // Time at which TakeDue has a call (in the past: now); none if no call waits.
  std::optional<Time> NextDue() const;
  // Removes and returns a woken or due call.
  std::optional<LeaseCall> TakeDue(Time now);
  std::optional<LeaseCall> Take(const std::string& worker);

  // Sleeps until TakeDue has a call and returns the time to pass to it; none after End if no call waits. `lock`: of the
  // mutex that guards this object. Call from one thread only.
  std::optional<Time> AwaitDue(std::unique_lock<std::mutex>& lock);
  // Wakes AwaitDue if a call is due earlier than it sleeps. Call after every change that can make a call due.
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
  Time sleeps_until_ = Time::min();  // of AwaitDue; min: not sleeping
  bool ends_ = false;
  int64_t generation_ = 0;
  std::map<std::string, Waiter> of_worker_;
  std::list<Waiter*> waiting_;                 // not woken, longest wait first, so ascending in `seen`
  std::list<Waiter*> woken_;                   // in the order of waking
  std::set<std::pair<Time, Waiter*>> by_due_;  // not woken
};

}  // namespace tessera
