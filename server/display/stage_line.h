// Progress of a command's own computation, on a terminal.
#pragma once

#include <chrono>
#include <mutex>
#include <string>

namespace tessera {

// One line on standard error: a bar, the stage and the seconds left. Redrawn in place and erased at the end; nothing is
// printed if standard error is not a terminal. Show may be called from any thread.
class StageLine {
 public:
  explicit StageLine(bool enabled);
  ~StageLine();
  void Show(double fraction, const std::string& stage);

 private:
  bool shown_;
  std::chrono::steady_clock::time_point start_;
  std::mutex mutex_;
  double last_s_ = -1;
};

}  // namespace tessera
