// What report.html shows of job.json.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Sums over tasks that ran in this job and whose time or memory was measured, beside what was predicted for them.
struct MeasuredTasks {
  int64_t tasks = 0;  // also those that were reused
  double used_core_s = 0, predicted_core_s = 0;
  double used_peak_bytes = 0, predicted_peak_bytes = 0;  // the largest of a task; only of tasks with measured memory
  double attempts_s = 0;                                 // wall time of all attempts
};

struct JobFacts {
  std::string name, display_name, scene, state, error, algorithm_version;
  std::string base;  // base job; empty: none
  std::string rollback_to;
  std::vector<int> rollback_tiles;
  std::vector<std::pair<std::string, std::string>> settings;  // name and value, in the order of the file
  std::vector<std::string> warnings;
  std::vector<std::pair<int, std::string>> quarantined;  // tile and reason
  std::optional<double> seconds, tasks, attempts, reused;
  std::map<std::string, MeasuredTasks> kinds;
  std::map<int, MeasuredTasks> tiles;
};

// `job_json`: the text of job.json. Parses one task at a time to bound memory. Fields that are missing or have another
// type are left empty. DATA_LOSS if the text is no JSON object.
StatusOr<JobFacts> ParseJobFacts(std::string_view job_json);

}  // namespace tessera
