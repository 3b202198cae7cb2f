// Resolves --base: the base job of an update, given as a job name or as the folder of an earlier run.
#pragma once

#include <string>

#include "common/base/status.h"

namespace tessera {

// A job that succeeded, and the data folder of its coordinator.
struct RunResult {
  std::string data_dir;  // absolute
  std::string job;       // "jobs/J"
};

// Writes the result to the state folder of a run (OUT/.tessera). Call when its job has succeeded.
Status WriteRunResult(const std::string& state_dir, const RunResult& result);

// `base`: the value of --base, "jobs/J" (in `data_dir`) or the folder with an earlier run's results. INVALID_ARGUMENT
// if it is neither, or if `data_dir` is not empty and the run used another one.
StatusOr<RunResult> ResolveBaseJob(const std::string& base, const std::string& data_dir);

}  // namespace tessera
