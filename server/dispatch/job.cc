#include "server/dispatch/job.h"

namespace tessera {
namespace {

// The number in `text`, 1 to 9 digits without leading zero; else -1.
int ParseNumber(const std::string& text) {
  if (text.empty() || text.size() > 9 || (text[0] == '0' && text.size() > 1)) return -1;
  int number = 0;
  for (const char c : text) {
    if (c < '0' || c > '9') return -1;
    number = number * 10 + (c - '0');
  }
  return number;
}

constexpr char kJobs[] = "jobs/";
constexpr char kTasks[] = "/tasks/";

}  // namespace

// People count jobs from 1; tasks keep their index, which the plan's inputs name too.
std::string JobName(int job) { return kJobs + std::to_string(job + 1); }

std::string TaskName(TaskRef ref) { return JobName(ref.job) + kTasks + std::to_string(ref.task); }

StatusOr<int> ParseJobName(const std::string& name) {
  const std::string prefix = kJobs;
  const int number = name.compare(0, prefix.size(), prefix) == 0 ? ParseNumber(name.substr(prefix.size())) : -1;
  if (number < 1) return absl::InvalidArgumentError("not a job's name (jobs/J): '" + name + "'");
  return number - 1;
}

StatusOr<TaskRef> ParseTaskName(const std::string& name) {
  const size_t split = name.find(kTasks);
  if (split != std::string::npos) {
    const auto job = ParseJobName(name.substr(0, split));
    const int task = ParseNumber(name.substr(split + std::string(kTasks).size()));
    if (job.ok() && task >= 0) return TaskRef{*job, task};
  }
  return absl::InvalidArgumentError("not a task's name (jobs/J/tasks/T): '" + name + "'");
}

std::string ErrorClassName(ErrorClass error_class) {
  switch (error_class) {
    case ErrorClass::kNone:
      return "none";
    case ErrorClass::kInput:
      return "input";
    case ErrorClass::kTransient:
      return "transient";
    case ErrorClass::kMemory:
      return "memory";
    case ErrorClass::kPoison:
      return "poison";
    case ErrorClass::kAborted:
      return "aborted";
  }
  return "unknown";
}

}  // namespace tessera
