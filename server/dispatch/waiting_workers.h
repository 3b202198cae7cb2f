// Workers that wait for a task, and who of them is woken.
#ifndef TESSERA_SERVER_DISPATCH_WAITING_WORKERS_H_
#define TESSERA_SERVER_DISPATCH_WAITING_WORKERS_H_

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <list>
#include <map>
#include <mutex>
#include <string>

namespace tessera {

// One is woken for each task, not all for any. A worker that leaves a task to others wakes the next one, until all have
// seen what is ready. All calls under the mutex that Wait is given.
class WaitingWorkers {
 public:
  // Waits until it is woken, or `until`.
  void Wait(std::unique_lock<std::mutex>& lock, const std::string& worker, std::chrono::steady_clock::time_point until);
  // There is more that is ready than what those who wait now have seen.
  void ReadyHasGrown() { ++generation_; }
  // False if this worker does not wait.
  bool Wake(const std::string& worker);
  // Wakes who has waited longest, if that one has not seen what is ready now. False if all have.
  bool WakeNext();
  void WakeAll();

 private:
  struct Waiter {
    std::condition_variable woken;
    bool is_woken = false;
    int64_t seen = 0;  // generation
    std::list<Waiter*>::iterator place;
    std::multimap<std::string, Waiter*>::iterator of_worker;
  };
  void WakeOne(Waiter& waiter);

  int64_t generation_ = 0;
  std::list<Waiter*> waiting_;  // not woken yet, the longest first: so ascending in `seen`
  std::multimap<std::string, Waiter*> of_worker_;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPATCH_WAITING_WORKERS_H_
