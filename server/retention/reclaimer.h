// Deletes old jobs, and removes memory, records and blobs that no job needs.
#pragma once

#include <mutex>
#include <vector>

#include "common/base/status.h"
#include "server/leases/dispatch_core.h"
#include "server/ledger/blob_references.h"
#include "server/retention/retention.h"

namespace tessera {

// Holds the core's mutex only briefly. Thread-safe, except for one collection of blobs at a time. Errors of the stores.
class Reclaimer {
 public:
  // `core` must outlive this.
  explicit Reclaimer(DispatchCore& core) : core_(core) {}

  // Deletes expired jobs that are not the base of another job. Returns their number.
  StatusOr<int> DeleteExpired(Retention& retention);
  // Frees some memory and stored records of deleted jobs. False if nothing is left.
  StatusOr<bool> FreeDeleted();
  // All blobs that jobs refer to. Later references are noted until the next call.
  BlobReferences CollectReferences();
  // Removes the files without a new reference since CollectReferences. Returns the removed ones.
  StatusOr<std::vector<BlobEntry>> RemoveBlobs(const std::vector<BlobEntry>& files);

 private:
  DispatchCore& core_;
  const DispatchEnvironment& environment_ = core_.environment();
  std::mutex& mutex_ = core_.mutex();
  Ledger& ledger_ = core_.ledger();
};

}  // namespace tessera
