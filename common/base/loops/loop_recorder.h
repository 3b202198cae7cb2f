// What the parallel loops of a thread cost, chunk by chunk: for predictions of the speed on more cores (line_bench).
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <typeinfo>
#include <vector>

namespace tessera {

struct LoopRecord;

// A piece of work: processor seconds outside parallel loops, and the loops, in their order.
struct WorkRecord {
  double seconds = 0;
  std::vector<LoopRecord> loops;

  // With the loops.
  double TotalSeconds() const;
};

struct LoopRecord {
  const std::type_info* body = nullptr;  // type of the loop's body
  double seconds_before = 0;             // outside loops, since the previous loop of the same piece of work
  std::vector<WorkRecord> chunks;

  double TotalSeconds() const;
  // The function that contains the body; the body's parameters and, after '#', which lambda with these it is.
  std::string Name() const;
};

// While it exists, loops of its thread run on this thread alone, chunk by chunk, and are recorded. ThreadCount() stays
// as it is, so a ThreadLimit of N divides the work as on N cores. Loops of other threads are not recorded. At most one
// on a thread.
class LoopRecorder {
 public:
  LoopRecorder();
  ~LoopRecorder();
  LoopRecorder(const LoopRecorder&) = delete;
  LoopRecorder& operator=(const LoopRecorder&) = delete;

  // The recorder of the calling thread, or null.
  static LoopRecorder* OfThisThread() { return of_this_thread_; }

  // Runs a loop. Called by ParallelFor.
  void Run(int64_t chunks, const std::function<void(int64_t)>& run, const std::type_info& body);

  // What this thread has done since the recorder was made or last asked.
  WorkRecord Take();

 private:
  // Adds the processor time since the last call to the current piece of work. Returns it.
  double AddTime();

  static thread_local LoopRecorder* of_this_thread_;
  WorkRecord all_;
  WorkRecord* current_ = &all_;
  double last_s_ = 0, seconds_before_ = 0;
};

// Seconds of a piece of work on `cores` cores, by a schedule of the recorded chunks with the rule of ParallelFor: each
// core begins with its own part of the loop and then helps with those of the next cores. If there are more cores than
// chunks, loops within chunks share those that are left. A loop on several cores takes `loop_s` more. Memory bandwidth,
// caches and help of idle cores with a longer chunk's own loops are not modelled.
double PredictedSeconds(const WorkRecord& work, int cores, double loop_s);
double PredictedSeconds(const LoopRecord& loop, int cores, double loop_s);

}  // namespace tessera
