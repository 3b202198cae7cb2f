// Runs a command of a scheduler.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

struct CommandLimits {
  double seconds = 60;
  int64_t bytes = int64_t{1} << 30;                   // of its output
  std::function<bool()> stop = [] { return false; };  // ends the command when true
};

// Runs the program `words[0]`, looked up in PATH, without a shell, and returns what it writes to standard output.
// Errors name the command and have the last lines of its standard error: NOT_FOUND (no such program),
// ABORTED (time limit), RESOURCE_EXHAUSTED, CANCELLED (by `stop`), FAILED_PRECONDITION (it ended with
// another exit code than 0).
StatusOr<std::string> RunCommand(const std::vector<std::string>& words, const CommandLimits& limits);

}  // namespace tessera
