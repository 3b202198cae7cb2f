// The task that a record changes, for the log.
#pragma once

#include <deque>
#include <mutex>
#include <string>
#include <utility>

namespace tessera {

// The task that a record changes; empty for records of jobs.
struct ChangedTask {
  std::string kind = {};
  int tile = -1;            // -1: none
  std::string worker = {};  // of its last attempt
};

// A queue of the tasks of records that are not stored yet, in the order of the records. Thread-safe.
class ChangedTasks {
 public:
  void Push(ChangedTask task) {
    std::lock_guard lock(mutex_);
    tasks_.push_back(std::move(task));
  }
  // Precondition: not empty.
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
