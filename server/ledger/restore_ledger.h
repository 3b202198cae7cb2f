// Restores a ledger from its stored records.
#pragma once

#include <cstdint>
#include <functional>

#include "common/base/status.h"
#include "server/ledger/ledger.h"
#include "server/store/record_store.h"

namespace tessera {

// Applies the records of RecordStore::Replay in order, and reserves the numbers of deleted jobs without any record. A
// second thread reads and parses a few MiB ahead. `on_unusable` gets each record that is missing (DATA_LOSS), cannot be
// parsed or that CheckRecord refuses; such records are skipped. It must not use the store. Returns the number of
// applied records, or the store's error. Precondition: no record was applied to the ledger.
StatusOr<int64_t> RestoreLedger(
    RecordStore& store, Ledger& ledger,
    const std::function<void(int64_t number, const Status& reason, const v1::Record& record)>& on_unusable);

}  // namespace tessera
