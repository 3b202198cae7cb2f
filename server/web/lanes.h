// Threads that serve requests, in lanes: each lane has its own bounded number of threads and of waiting requests.
#pragma once

#include <array>
#include <condition_variable>
#include <functional>
#include <list>
#include <mutex>
#include <thread>
#include <vector>

namespace tessera {

// Which threads serve a request, so that slow ones do not stop the others.
enum class Lane { kQuick, kSlow, kFile, kStream };

struct LaneLimits {
  int threads = 1;
  size_t waiting = 0;  // requests that wait for a thread
};

// Starts threads when they are needed. Thread-safe.
class Lanes {
 public:
  static constexpr size_t kLanes = 4;
  // In the order of Lane.
  explicit Lanes(const std::array<LaneLimits, kLanes>& limits);
  // Runs what waits and joins the threads.
  ~Lanes();

  // False if the lane is full: `work` will not run.
  bool Run(Lane lane, std::function<void()> work);
  // From now on no work is taken.
  void Stop();
  // Number of threads that run or could run work.
  int threads() const;

 private:
  struct OneLane {
    LaneLimits limits;
    std::list<std::function<void()>> waiting;
    int idle = 0;
    std::vector<std::thread> threads;
    std::condition_variable changed;
  };
  void Serve(OneLane& lane);

  mutable std::mutex mutex_;
  bool stopped_ = false;
  std::array<OneLane, kLanes> lanes_;
};

}  // namespace tessera
