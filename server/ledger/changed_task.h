// The task that a record is about, for logs.
#pragma once

#include <deque>
#include <mutex>
#include <string>
#include <utility>

namespace tessera {

// The task that a record is about; empty for records of jobs.
struct ChangedTask {
  std::string kind = {};
  int tile = -1;            // -1: none
  std::string worker = {};  // of its last attempt
};

// Those of the records that are not stored yet, in their order. Thread-safe.
class ChangedTasks {
 public:
  void Push(ChangedTask task) {
    std::lock_guard lock(mutex_);
    tasks_.push_back(std::move(task));
  }
  // The first, which must be there.
  ChangedTask Pop() {
    std::lock_guard lock(mutex_);
    ChangedTask task = std::move(tasks_.front());
    tasks_.pop_front();
    return task;
  }

 private:
  std::mutex mutex_;
  std::deque<ChangedTask> tasks_;
};

}  // namespace tessera
