// Deletes old jobs, and removes memory, records and blobs that no job needs.
#pragma once

#include <functional>
#include <mutex>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "server/leases/dispatch_core.h"
#include "server/ledger/blob_references.h"
#include "server/retention/retention.h"

namespace tessera {

// Holds the core's mutex only briefly. Thread-safe, except for one collection of blobs at a time. Errors of the stores.
class Reclaimer {
 public:
  // `core` must outlive this. `may_remove`: asked right before blobs are removed; false while another coordinator may
  // have taken over, whose references this one does not know. May be empty.
  explicit Reclaimer(DispatchCore& core, std::function<bool()> may_remove = {})
      : core_(core), may_remove_(std::move(may_remove)) {}

  // Deletes expired jobs that are not the base of another job. Returns their number.
  StatusOr<int> DeleteExpired(Retention& retention);
  // Frees some memory and stored records of deleted jobs. False if nothing is left.
  StatusOr<bool> FreeDeleted();
  // All blobs that jobs refer to. Later references are noted until the next call.
  BlobReferences CollectReferences();
  // Removes the files without a new reference since CollectReferences, as long as `may_remove` allows it. Returns the
  // removed ones.
  StatusOr<std::vector<BlobEntry>> RemoveBlobs(const std::vector<BlobEntry>& files);

 private:
  DispatchCore& core_;
  const std::function<bool()> may_remove_;
  const DispatchEnvironment& environment_ = core_.environment();
  std::mutex& mutex_ = core_.mutex();
  Ledger& ledger_ = core_.ledger();
};

}  // namespace tessera
