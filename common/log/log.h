// The log of a process on standard error: one line per event, with one schema for all programs.
//
//   2026-11-23T03:35:06.123Z warning attempt failed job=jobs/3 tile=7 task=jobs/3/tasks/41 attempt=2 error="it broke"
//   {"time":"2026-11-23T03:35:06.123Z","level":"warning","message":"attempt failed","job":"jobs/3","tile":"7",...}
//
// Common fields have the names job, tile, task, attempt, worker, peer and user. Values are escaped and quoted, so that
// text from outside cannot start a new line or end its quotes.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// In the order of spdlog's levels.
enum class LogLevel { kDebug, kInfo, kWarning, kError };

using LogFields = std::vector<std::pair<std::string, std::string>>;

// `level`: debug, info, warn, error or off; INVALID_ARGUMENT for another. Call once, before any thread logs.
Status SetUpLog(const std::string& level, bool json);

// Thread-safe. Keys are trusted constants. Values and the message are cut at 16 KiB.
void LogEvent(LogLevel level, const std::string& message, const LogFields& fields = {});

inline void LogDebug(const std::string& message, const LogFields& fields = {}) {
  LogEvent(LogLevel::kDebug, message, fields);
}
inline void LogInfo(const std::string& message, const LogFields& fields = {}) {
  LogEvent(LogLevel::kInfo, message, fields);
}
inline void LogWarning(const std::string& message, const LogFields& fields = {}) {
  LogEvent(LogLevel::kWarning, message, fields);
}
inline void LogError(const std::string& message, const LogFields& fields = {}) {
  LogEvent(LogLevel::kError, message, fields);
}

// The part of a line after time and level, as text or JSON.
std::string LogLine(const std::string& message, const LogFields& fields, bool json);

}  // namespace tessera
