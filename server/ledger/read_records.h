// Stored records, read and parsed by a second thread ahead of the one that applies them.
#pragma once

#include <cstdint>
#include <functional>

#include "common/base/status.h"
#include "server/store/record_store.h"

namespace tessera {

namespace v1 {
class Record;
}  // namespace v1

// Calls `visit` for each record of RecordStore::Replay, in order and in this thread, while another reads and parses
// those behind it: some MiB, however many there are. `status`: why there is none; DATA_LOSS if its bytes are no record.
// `visit` must not use the store. Errors are the store's.
Status ReadRecords(RecordStore& store,
                   const std::function<void(int64_t number, Status status, const v1::Record& record)>& visit);

}  // namespace tessera
