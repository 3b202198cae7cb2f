// The log of a process on standard error, of one schema for all programs: one line an event.
//
//   2026-11-23T03:35:06.123Z warning attempt failed job=jobs/3 tile=7 task=jobs/3/tasks/41 attempt=2 error="it broke"
//   {"time":"2026-11-23T03:35:06.123Z","level":"warning","message":"attempt failed","job":"jobs/3","tile":"7",...}
//
// Where an event has these, the fields are named job, tile, task, attempt, worker, peer and user. Values may come from
// anywhere: whatever is in them, an event stays one line and a value within its quotes.
#ifndef TESSERA_COMMON_LOG_LOG_H_
#define TESSERA_COMMON_LOG_LOG_H_

#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"

namespace tessera {

enum class LogLevel { kDebug, kInfo, kWarning, kError };

using LogFields = std::vector<std::pair<std::string, std::string>>;

// `level`: debug, info, warn, error or off; INVALID_ARGUMENT for another. Call once, before any thread logs.
Status SetUpLog(const std::string& level, bool json);

// Thread-safe. Keys are ours; of a value the first 16 KiB are logged.
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

// What follows time and level on a line, of either form.
std::string LogLine(const std::string& message, const LogFields& fields, bool json);

}  // namespace tessera

#endif  // TESSERA_COMMON_LOG_LOG_H_
