// Log lines for changes of the coordinator's state (common/log).
#pragma once

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

// Logs a change of state. `task`: the task of the record, if it has one.
void LogRecord(const v1::Record& record, const ChangedTask& task);

// Logs that a worker gets no tasks for some time.
void LogWorkerSuspended(const SuspendedWorker& worker);

// Logs that a stored record is unusable and quarantined.
void LogRecordQuarantined(int64_t number, const std::string& reason);

// Logs why journal writes fail or, if `trouble` is OK, that they succeed again.
void LogJournalStatus(const Status& trouble);

}  // namespace tessera
