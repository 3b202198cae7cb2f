// How long work tells its progress and learns that it is no longer wanted.
#ifndef TESSERA_COMMON_BASE_TASK_CONTROL_H_
#define TESSERA_COMMON_BASE_TASK_CONTROL_H_

#include <functional>
#include <string>

#include "common/base/status.h"

namespace tessera {

// Both functions may be empty, and may be called from any thread.
struct TaskControl {
  // fraction in [0, 1] of the whole call, and what is being done ("level 2, step 7 of 20").
  std::function<void(double fraction, const std::string& stage)> report;
  std::function<bool()> cancelled;

  void Report(double fraction, const std::string& stage) const {
    if (report) report(fraction, stage);
  }
  // CANCELLED if the work should stop; long loops return it at once.
  Status Check() const {
    if (cancelled && cancelled()) return absl::CancelledError("cancelled");
    return absl::OkStatus();
  }
};

// The part [low, high] of `control`'s progress as a whole of its own. `control` must outlive it.
inline TaskControl PartOf(const TaskControl& control, double low, double high) {
  TaskControl part;
  part.cancelled = control.cancelled;
  part.report = [&control, low, high](double fraction, const std::string& stage) {
    control.Report(low + (high - low) * fraction, stage);
  };
  return part;
}

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_TASK_CONTROL_H_
