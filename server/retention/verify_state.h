// Checks the stored state of a coordinator offline.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "common/base/status.h"
#include "common/storage/blob_store.h"
#include "server/store/record_store.h"

namespace tessera {

struct StateSummary {
  int64_t records = 0;  // usable records
  int64_t jobs = 0;
  int64_t blobs = 0;  // distinct blobs that jobs refer to
  int64_t spare = 0;  // of these: missing, but recomputed when needed
  int64_t faults = 0;
};

// Reads all records and checks that every blob they refer to exists; `deep`: hashes the blobs too. Calls `tell` with
// the location, found and expected of each fault. Quarantines damaged blobs, so that they are recomputed when needed;
// leaves records to Coordinator::QuarantineUnusable. Fails only if the store cannot be read.
StatusOr<StateSummary> VerifyState(RecordStore& store, BlobStore& blobs, bool deep,
                                   const std::function<void(const std::string& fault)>& tell);

}  // namespace tessera
