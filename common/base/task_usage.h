// What a task took of its machine: processor time and memory.
#ifndef TESSERA_COMMON_BASE_TASK_USAGE_H_
#define TESSERA_COMMON_BASE_TASK_USAGE_H_

#include <chrono>
#include <cstdint>
#include <map>
#include <string>

namespace tessera {

struct TaskUsage {
  double core_seconds = 0;  // processor time of all threads, the system's on their behalf included
  int64_t peak_bytes = 0;   // resident memory at its highest, but what the process held before it; 0: not known
  int threads = 0;          // that the task could use; 0: not known
};

// From its construction on, for the whole process: of use where a process runs one task at a time, and one meter at a
// time. Before a peak is measured, memory that earlier tasks freed is handed back to the system, so that they do not
// count, nor does what they keep.
//
// The peak is Linux's VmHWM, set back by way of /proc/self/clear_refs. Where that cannot be written (no such file, or
// no right to it) the peak is known only if the process has risen above all that it held before.
class TaskUsageMeter {
 public:
  // Without the peak it is not known, and costs nothing.
  explicit TaskUsageMeter(bool with_peak = true);
  TaskUsage Read() const;

 private:
  double start_core_seconds_ = 0;
  int64_t start_peak_bytes_ = 0, held_bytes_ = 0;
  bool with_peak_ = false, peak_was_reset_ = false;
};

// Of which tasks to measure the peak: memory that is handed back before each of many short tasks must be had again
// page by page, which took longer than the tasks (a job of three tiles: 48 core-seconds for 24).
// Not thread-safe.
class PeakSampling {
 public:
  using Clock = std::chrono::steady_clock;
  // Whether this task of a kind is the first, or the first in ten seconds since one that was.
  bool IsDue(const std::string& kind, Clock::time_point now = Clock::now());

 private:
  std::map<std::string, Clock::time_point> measured_;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_TASK_USAGE_H_
