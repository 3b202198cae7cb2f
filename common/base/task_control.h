// Progress reports and cancellation of long-running work.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Both functions may be empty. They are called from any thread.
struct TaskControl {
  // `fraction`: the finished share of the call, in [0, 1]. `stage`: the current step ("level 2, step 7 of 20").
  std::function<void(double fraction, const std::string& stage)> report;
  std::function<bool()> cancelled;

  void Report(double fraction, const std::string& stage) const {
    if (report) report(fraction, stage);
  }
  // CANCELLED if the work should stop. Long loops call it regularly and return its error.
  Status Check() const {
    if (cancelled && cancelled()) return absl::CancelledError("cancelled");
    return absl::OkStatus();
  }
};

// Makes files of a task's input folder readable, by their paths; files that are readable stay so. Empty: all are.
using FetchFiles = std::function<Status(const std::vector<std::string>& paths)>;

// A control for a part of the work: its progress 0 to 1 is reported to `control` as `low` to `high`. `control` must
// outlive it.
inline TaskControl PartOf(const TaskControl& control, double low, double high) {
  TaskControl part;
  part.cancelled = control.cancelled;
  part.report = [&control, low, high](double fraction, const std::string& stage) {
    control.Report(low + (high - low) * fraction, stage);
  };
  return part;
}

}  // namespace tessera
