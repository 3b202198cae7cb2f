// State of the current attempt, shared by the task's thread and the heartbeat thread.
#pragma once

#include <algorithm>
#include <atomic>
#include <mutex>
#include <string>
#include <utility>

#include "worker/agent/coordinator_link.h"

namespace tessera {

// Thread-safe.
class Attempt {
 public:
  Attempt(std::string task, int number) : task_(std::move(task)), number_(number) {}

  const std::string& task() const { return task_; }
  int number() const { return number_; }

  void SetProgress(double fraction, const std::string& stage) {
    std::lock_guard lock(mutex_);
    fraction_ = std::clamp(fraction, 0.0, 1.0);
    stage_ = stage;
  }
  AttemptProgress Progress() const {
    std::lock_guard lock(mutex_);
    return {task_, number_, fraction_, stage_};
  }

  // The lease is lost: stop, discard everything, report nothing.
  void MarkLeaseLost() { lease_lost_ = true; }
  bool LeaseLost() const { return lease_lost_; }

 private:
  const std::string task_;
  const int number_;
  mutable std::mutex mutex_;
  double fraction_ = 0;
  std::string stage_;
  std::atomic<bool> lease_lost_{false};
};

}  // namespace tessera
