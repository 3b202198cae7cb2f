// Browsers that have the page of a job open, over HTTP on loopback.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace tessera {

// Opens `pages` pages of `job`, which has `tiles` tiles, while the file `open` exists, closes them while it does not,
// and returns when the file `address`, which has HOST:PORT, is taken away. Of the pages, 64 follow the event stream,
// the others poll the state every 2 s with its ETag. After a change they ask for the list of tiles, at most once in
// max(1 s, 4 ms a tile). Prints what was asked and received, and the processor time of this process.
void RunPageClients(int pages, int tiles, const std::string& job, const std::string& address, const std::string& open);

// Opens and closes the pages in turns, and compares the coordinator's work with and without them.
class PageTurns {
 public:
  explicit PageTurns(std::string open) : open_(std::move(open)) {}
  // To be called often, with the tasks that are done and the processor time that the coordinator has used.
  void Step(int tasks_done, double cpu_s);
  // Closes the pages and prints the ratios.
  void End();

 private:
  struct Turn {
    bool open = false;
    double tasks_per_s = 0, cpu_s_per_task = 0;
  };
  const std::string open_;  // file
  bool is_open_ = false, counts_ = false;
  double turn_s_ = 0, count_s_ = 0;  // when it began
  int tasks_ = 0;                    // when the count began
  double cpu_s_ = 0;
  std::vector<Turn> turns_;
};

}  // namespace tessera
