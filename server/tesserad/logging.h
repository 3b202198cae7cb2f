// Log lines of changes of the coordinator's state (common/log).
#ifndef TESSERA_SERVER_TESSERAD_LOGGING_H_
#define TESSERA_SERVER_TESSERAD_LOGGING_H_

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "common/log/log.h"

namespace tessera {

namespace v1 {
class Record;
}  // namespace v1
struct ChangedTask;
struct SuspendedWorker;

// A change of state. `task`: of the record, if it has one.
void LogRecord(const v1::Record& record, const ChangedTask& task);

// A worker is suspended.
void LogWorkerSuspended(const SuspendedWorker& worker);

// A stored record cannot be used.
void LogRecordQuarantined(int64_t number, const std::string& reason);

// Records cannot be stored now, with the reason; if OK: they can again.
void LogStorageTrouble(const Status& trouble);

}  // namespace tessera

#endif  // TESSERA_SERVER_TESSERAD_LOGGING_H_
