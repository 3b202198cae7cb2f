// Watches a job of a coordinator until it has ended.
#pragma once

#include <string>

#include "server/client/connection.h"

namespace tessera {

// Shows progress on standard error. Returns the exit code; error messages name `command`.
int WatchJobWithProgress(Connection& connection, const std::string& job, const std::string& command);

// Prints one JSON object per change on standard output.
int WatchJobAsJson(Connection& connection, const std::string& job, const std::string& command);

}  // namespace tessera
