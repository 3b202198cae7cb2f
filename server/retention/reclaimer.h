// Deletes old jobs, and removes memory, records and blobs that no job needs.
#pragma once

#include <mutex>
#include <vector>

#include "common/base/status.h"
#include "server/leases/dispatch_core.h"
#include "server/ledger/blob_references.h"
#include "server/retention/retention.h"

namespace tessera {

// Each call holds the core's mutex for short times only. Thread-safe, but for one collection of blobs at a time.
class Reclaimer {
 public:
  // `core` must outlive this.
  explicit Reclaimer(DispatchCore& core) : core_(core) {}

  // Deletes the jobs that have expired and that no other needs. Returns how many.
  StatusOr<int> DeleteExpired(Retention& retention);
  // Frees a part of the memory and of the stored records of deleted jobs. False if nothing is left.
  StatusOr<bool> FreeDeleted();
  // Blobs that jobs refer to. References that are added later are noted, until the next call.
  BlobReferences CollectReferences();
  // Removes those of the files that no job has come to refer to since CollectReferences. Returns those that it removed.
  StatusOr<std::vector<BlobEntry>> RemoveBlobs(const std::vector<BlobEntry>& files);

 private:
  DispatchCore& core_;
  const DispatchEnvironment& environment_ = core_.environment();
  std::mutex& mutex_ = core_.mutex();
  Ledger& ledger_ = core_.ledger();
};

}  // namespace tessera
