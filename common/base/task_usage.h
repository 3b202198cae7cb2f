// Measures the processor time and memory of a task; how a process keeps memory between tasks.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <string>

namespace tessera {

// Freed memory stays with the process, up to `bytes` of it at the end of the heap, and blocks of up to 32 MiB are taken
// from there: memory that every step of a tile uses again is not given back to the system and mapped page by page each
// time. Eight threads share one heap, so that what one of them frees serves the others, and few wait for its lock. Call
// it at the start of a program, before starting threads.
void KeepFreedMemory(int64_t bytes);

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

// Selects the tasks whose peak is measured. Trimmed memory must be mapped again page by page: a measured peak of a step
// may cost as much as the step. Not thread-safe.
class PeakSampling {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::minutes kPause{10};
  // True for the first task of a kind, and for the first that comes kPause or more after the last with result true.
  bool IsDue(const std::string& kind, Clock::time_point now = Clock::now());

 private:
  std::map<std::string, Clock::time_point> measured_;
};

}  // namespace tessera
