// How a job goes, on a terminal (a bar and who does what, redrawn) or in plain lines.
#ifndef TESSERA_SERVER_DISPLAY_PROGRESS_DISPLAY_H_
#define TESSERA_SERVER_DISPLAY_PROGRESS_DISPLAY_H_

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
  // Draws on `out`, which must outlive it; a bar only if it is a terminal that can move its cursor.
  explicit ProgressDisplay(std::FILE* out);

  void Show(const v1::WatchJobResponse& update);
  // A line that stays, above the bar.
  void Note(const std::string& line);
  // Leaves what is shown and goes on below it.
  void Finish();

  // The lines of the bar, `width` characters at most.
  static std::vector<std::string> Picture(const v1::WatchJobResponse& update, int width);

 private:
  void Erase();
  void Draw();
  void ShowPlain(const v1::WatchJobResponse& update);

  std::FILE* const out_;
  const bool terminal_;
  std::vector<std::string> shown_;  // lines on the terminal now
  int last_state_ = -1;             // plain lines: what was told last
  bool last_paused_ = false;
  std::string last_waiting_;
  int last_tiles_ = -1;
  int last_tenth_ = 0;
  std::map<std::string, int> told_;  // attempts told, by task
};

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPLAY_PROGRESS_DISPLAY_H_
