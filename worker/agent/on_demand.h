// Which inputs of a task are fetched before it runs, and which when it asks for them.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/job/task_parameters.h"
#include "worker/agent/coordinator_link.h"

namespace tessera {

// The inputs of a task that are fetched when it asks for them.
class OnDemand {
 public:
  OnDemand(const std::vector<TaskInput>& inputs, const std::string& input_dir) {
    FetchedOnDemand on_demand;
    for (const TaskInput& input : inputs) on_demand.AddInput(input.name);
    for (const TaskInput& input : inputs) {
      if (on_demand(input.name)) {
        later_.emplace(input_dir + "/" + input.name, input);
      } else {
        others_.push_back(input);
      }
    }
  }

  // Those that are fetched before the task runs.
  std::vector<TaskInput> TakeOthers() { return std::move(others_); }
  // Those at these paths that were not taken before.
  std::vector<TaskInput> Take(const std::vector<std::string>& paths) {
    std::vector<TaskInput> taken;
    for (const std::string& path : paths) {
      auto found = later_.extract(path);
      if (found) taken.push_back(std::move(found.mapped()));
    }
    return taken;
  }

 private:
  std::vector<TaskInput> others_;
  std::map<std::string, TaskInput> later_;  // by path
};

}  // namespace tessera
