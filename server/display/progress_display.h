// Progress of a job: a bar and the running tasks, redrawn on a terminal; plain lines elsewhere.
#pragma once

#include <cstdio>
#include <map>
#include <string>
#include <vector>

namespace tessera {

namespace v1 {
class WatchJobResponse;
}  // namespace v1

// Not thread-safe.
class ProgressDisplay {
 public:
  // Writes to `out`, which must outlive the display. Draws a bar only if `out` is a terminal that can move its cursor.
  explicit ProgressDisplay(std::FILE* out);

  void Show(const v1::WatchJobResponse& update);
  // Prints a permanent line above the bar.
  void Note(const std::string& line);
  // Keeps the lines shown; later output goes below them.
  void Finish();

  // The lines of the display, each at most `width` characters.
  static std::vector<std::string> RenderLines(const v1::WatchJobResponse& update, int width);

 private:
  void Erase();
  void Draw();
  void ShowPlain(const v1::WatchJobResponse& update);

  std::FILE* const out_;
  const bool terminal_;
  std::vector<std::string> shown_;  // lines on the terminal now
  int last_state_ = -1;             // plain lines: values printed last
  bool last_paused_ = false;
  std::string last_waiting_;
  int last_tiles_ = -1;
  int last_tenth_ = 0;
  std::map<std::string, int> printed_attempts_;  // by task
};

}  // namespace tessera
