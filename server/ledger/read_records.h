// Reads and parses stored records in a second thread, ahead of the thread that applies them.
#pragma once

#include <cstdint>
#include <functional>

#include "common/base/status.h"
#include "server/store/record_store.h"

namespace tessera {

namespace v1 {
class Record;
}  // namespace v1

// Calls `visit` in this thread for each record of RecordStore::Replay, in order; a second thread reads a few MiB ahead.
// `status`: why the record is missing; DATA_LOSS if it cannot be parsed. `visit` must not use the store. Returns the
// store's errors.
Status ReadRecords(RecordStore& store,
                   const std::function<void(int64_t number, Status status, const v1::Record& record)>& visit);

}  // namespace tessera
