// Measures the processor time and memory of a task.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <string>

namespace tessera {

struct TaskUsage {
  double core_seconds = 0;  // processor time of all threads, user and system
  int64_t peak_bytes = 0;   // peak resident memory minus the memory that earlier tasks retained; 0: unknown
  int threads = 0;          // threads available to the task; 0: unknown
};

// Measures the whole process from construction on. Use one meter at a time, in a process that runs one task at a time.
// Before measuring a peak it returns freed memory to the system (malloc_trim) and subtracts what earlier tasks
// retained.
//
// The peak is Linux's VmHWM, reset through /proc/self/clear_refs. If that file cannot be written, the peak is known
// only if the process exceeds its highest use before.
class TaskUsageMeter {
 public:
  // `with_peak` false: peak_bytes stays 0, and memory is neither trimmed nor measured.
  explicit TaskUsageMeter(bool with_peak = true);
  TaskUsage Read() const;

 private:
  double start_core_seconds_ = 0;
  int64_t start_peak_bytes_ = 0, held_bytes_ = 0;
  bool with_peak_ = false, peak_was_reset_ = false;
};

// Selects the tasks whose peak is measured. Measuring every short task is too slow, because trimmed memory must be
// mapped again page by page (a job of three tiles took 48 core-seconds instead of 24). Not thread-safe.
class PeakSampling {
 public:
  using Clock = std::chrono::steady_clock;
  // True for the first task of a kind, and again when 10 s have passed since the last task with result true.
  bool IsDue(const std::string& kind, Clock::time_point now = Clock::now());

 private:
  std::map<std::string, Clock::time_point> measured_;
};

}  // namespace tessera
