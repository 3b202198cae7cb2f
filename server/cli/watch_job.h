// Watches a job of a coordinator until it has ended.
#ifndef TESSERA_SERVER_CLI_WATCH_JOB_H_
#define TESSERA_SERVER_CLI_WATCH_JOB_H_

#include <string>

#include "server/client/connection.h"

namespace tessera {

// Shows progress on standard error. Returns the exit code; error messages name `command`.
int WatchJobWithProgress(Connection& connection, const std::string& job, const std::string& command);

// Prints one JSON object per change on standard output.
int WatchJobAsJson(Connection& connection, const std::string& job, const std::string& command);

}  // namespace tessera

#endif  // TESSERA_SERVER_CLI_WATCH_JOB_H_
