// What changes of the coordinator's state say in its log (common/log).
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
struct SetAsideWorker;

// What a change of state says to an operator. `task`: of the record, where it is of one.
void LogRecord(const v1::Record& record, const ChangedTask& task);

// That a worker gets no tasks for some time.
void LogWorkerSetAside(const SetAsideWorker& worker);

// That a stored record cannot be used.
void LogSetAside(int64_t number, const std::string& reason);

// That records cannot be stored now, and why; or, if OK, that they can again.
void LogStorageTrouble(const Status& trouble);

}  // namespace tessera

#endif  // TESSERA_SERVER_TESSERAD_LOGGING_H_
