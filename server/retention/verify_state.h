// Checks all that a coordinator stored, without serving it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "common/base/status.h"
#include "common/storage/blob_store.h"
#include "server/store/record_store.h"

namespace tessera {

struct StateSummary {
  int64_t records = 0;  // usable
  int64_t jobs = 0;
  int64_t blobs = 0;  // that jobs refer to, each once
  int64_t spare = 0;  // of these, missing, but made again when they are needed, or being made again
  int64_t faults = 0;
};

// Reads all records and checks that every blob that they refer to exists; with `deep` hashes the blobs too. `tell` is
// called with each fault: where, what was found and what was expected. Damaged blobs are quarantined, so that they are
// made again when they are needed; records stay for Coordinator::QuarantineUnusable.
StatusOr<StateSummary> VerifyState(RecordStore& store, BlobStore& blobs, bool deep,
                                   const std::function<void(const std::string& fault)>& tell);

}  // namespace tessera
