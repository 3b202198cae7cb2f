// Threads that serve requests, in lanes: each lane has its own bounded number of threads and of waiting requests.
#pragma once

#include <array>
#include <condition_variable>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace tessera {

// Which threads serve a request, so that slow ones do not stop the others.
enum class Lane { kQuick, kSlow, kFile, kStream };

struct LaneLimits {
  int threads = 1;
  size_t waiting = 0;  // requests that wait for a thread
  // Threads that one owner of requests may have; half of the waiting requests may be its. 0: all.
  int of_owner = 0;
};

// Starts threads when they are needed. Requests run in the order of their arrival, except that those of an owner that
// has its share of the threads wait. Thread-safe.
class Lanes {
 public:
  static constexpr size_t kLanes = 4;
  // In the order of Lane.
  explicit Lanes(const std::array<LaneLimits, kLanes>& limits);
  // Runs what waits and joins the threads.
  ~Lanes();

  // False if the lane is full, for all or for this owner: `work` will not run.
  bool Run(Lane lane, const std::string& owner, std::function<void()> work);
  // From now on no work is taken.
  void Stop();
  // Number of threads that run or could run work.
  int threads() const;

 private:
  struct Request {
    std::string owner;
    std::function<void()> work;
  };
  struct OneLane {
    LaneLimits limits;
    std::list<Request> waiting;
    std::map<std::string, int> waiting_of, running_of;  // number of requests by owner; none is 0
    int idle = 0;
    std::vector<std::thread> threads;
    std::condition_variable changed;
  };
  void Serve(OneLane& lane);
  // The first request that may run now; the end if there is none.
  std::list<Request>::iterator NextLocked(OneLane& lane);

  mutable std::mutex mutex_;
  bool stopped_ = false;
  std::array<OneLane, kLanes> lanes_;
};

}  // namespace tessera
