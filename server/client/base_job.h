// Which job an update goes on from, where `tessera run` and `tessera plan` take it from the folder of an earlier run.
#ifndef TESSERA_SERVER_CLIENT_BASE_JOB_H_
#define TESSERA_SERVER_CLIENT_BASE_JOB_H_

#include <string>

#include "common/base/status.h"

namespace tessera {

// A job that succeeded here, and the folder with the coordinator's state that knows it.
struct RunResult {
  std::string data_dir;  // absolute
  std::string job;       // "jobs/J"
};

// In the state folder of a run (OUT/.tessera), once its job has succeeded.
Status WriteRunResult(const std::string& state_dir, const RunResult& result);

// `base` as given to --base: "jobs/J" (in `data_dir`), or the folder with an earlier run's results. INVALID_ARGUMENT if
// it is neither, or has other state than `data_dir`, if that is not empty.
StatusOr<RunResult> FindBase(const std::string& base, const std::string& data_dir);

}  // namespace tessera

#endif  // TESSERA_SERVER_CLIENT_BASE_JOB_H_
