// The program that a profile names to make credentials.
#pragma once

#include <string>

#include "common/base/status.h"

namespace tessera {

inline constexpr int64_t kMaxCredentialBytes = 64 << 10;

// Runs `command` with /bin/sh and returns what it writes to standard output. Its standard input is empty, its errors go
// to those of this process. It is killed, with its children, after `seconds` or more than kMaxCredentialBytes.
// FAILED_PRECONDITION if it fails; no message has its output or the command.
StatusOr<std::string> RunCredentialProcess(const std::string& command, double seconds);

}  // namespace tessera
