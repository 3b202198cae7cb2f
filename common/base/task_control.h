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

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_TASK_CONTROL_H_
