// Watching a job of a coordinator until it has ended.
#ifndef TESSERA_SERVER_CLI_WATCHING_H_
#define TESSERA_SERVER_CLI_WATCHING_H_

#include <string>

#include "server/client/connection.h"

namespace tessera {

// Shows progress on standard error. Gives the exit code, errors told in the name of `command`.
int WatchToTheEnd(Connection& connection, const std::string& job, const std::string& command);

// One JSON object a change on standard output.
int WatchAsJson(Connection& connection, const std::string& job, const std::string& command);

}  // namespace tessera

#endif  // TESSERA_SERVER_CLI_WATCHING_H_
