// What a task took of its machine: processor time and memory.
#ifndef TESSERA_COMMON_BASE_TASK_USAGE_H_
#define TESSERA_COMMON_BASE_TASK_USAGE_H_

#include <cstdint>

namespace tessera {

struct TaskUsage {
  double core_seconds = 0;  // processor time of all threads, the system's on their behalf included
  int64_t peak_bytes = 0;   // resident memory at its highest, but what the process held before it; 0: not known
  int threads = 0;          // that the task could use; 0: not known
};

// From its construction on, for the whole process: of use where a process runs one task at a time, and one meter at a
// time. Before it begins, memory that earlier tasks freed is handed back to the system, so that they do not count, nor
// does what they keep.
//
// The peak is Linux's VmHWM, set back by way of /proc/self/clear_refs. Where that cannot be written (no such file, or
// no right to it) the peak is known only if the process has risen above all that it held before.
class TaskUsageMeter {
 public:
  TaskUsageMeter();
  TaskUsage Read() const;

 private:
  double start_core_seconds_ = 0;
  int64_t start_peak_bytes_ = 0, held_bytes_ = 0;
  bool peak_was_reset_ = false;
};

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_TASK_USAGE_H_
