// How a command's own work goes, on a terminal.
#ifndef TESSERA_SERVER_DISPLAY_STAGE_LINE_H_
#define TESSERA_SERVER_DISPLAY_STAGE_LINE_H_

#include <chrono>
#include <mutex>
#include <string>

namespace tessera {

// One line on standard error: a bar, the stage and the seconds left, redrawn in place and erased in the end; nothing
// where that is no terminal. Show may be called from any thread.
class StageLine {
 public:
  explicit StageLine(bool wanted);
  ~StageLine();
  void Show(double fraction, const std::string& stage);

 private:
  bool shown_;
  std::chrono::steady_clock::time_point start_;
  std::mutex mutex_;
  double last_s_ = -1;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPLAY_STAGE_LINE_H_
