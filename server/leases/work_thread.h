// A thread that runs work in the background.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>

namespace tessera {

// Runs work items one at a time, in order. Thread-safe.
class WorkThread {
 public:
  WorkThread() : thread_([this] { Run(); }) {}
  // Runs all queued items first.
  ~WorkThread();
  void Do(std::function<void()> work);

 private:
  void Run();

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> work_;
  bool ends_ = false;
  std::thread thread_;
};

}  // namespace tessera
