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

// Selects the tasks whose peak is measured. Measuring every short task is too slow, because trimmed memory must be
// mapped again page by page (a job of three tiles took 48 core-seconds instead of 24). Not thread-safe.
class PeakSampling {
 public:
  using Clock = std::chrono::steady_clock;
  // True for the first task of a kind, and again 10, 30, 70, 150, ... s after the first: each time at least twice as
  // long after the last task with result true as before, at most 10 min.
  bool IsDue(const std::string& kind, Clock::time_point now = Clock::now());

 private:
  struct Measured {
    Clock::time_point last;
    std::chrono::seconds pause;  // until the next
  };
  std::map<std::string, Measured> measured_;
};

}  // namespace tessera
