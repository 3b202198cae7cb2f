// The coordinator's log on standard error: one line an event, "level message key=value ...", or one JSON object a line.
#ifndef TESSERA_SERVER_API_LOGGING_H_
#define TESSERA_SERVER_API_LOGGING_H_

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"

namespace tessera {

namespace v1 {
class Record;
}  // namespace v1
struct SetAsideWorker;

enum class LogLevel { kDebug, kInfo, kWarning, kError };

// `level`: "debug", "info", "warn", "error" or "off". To be called once, before the first LogEvent.
Status ConfigureLogging(const std::string& level, bool json);

// Thread-safe.
void LogEvent(LogLevel level, const std::string& message,
              const std::vector<std::pair<std::string, std::string>>& fields = {});

// What a change of state says to an operator.
void LogRecord(const v1::Record& record);

// That a worker gets no tasks for some time.
void LogWorkerSetAside(const SetAsideWorker& worker);

// That a stored record cannot be used.
void LogSetAside(int64_t number, const std::string& reason);

// That records cannot be stored now, and why; or, if OK, that they can again.
void LogStorageTrouble(const Status& trouble);

}  // namespace tessera

#endif  // TESSERA_SERVER_API_LOGGING_H_
