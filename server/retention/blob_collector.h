// Removes unreferenced blobs, expired quarantined blobs, and recomputable ones if the folder is too large.
#pragma once

#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/storage/blob_store.h"
#include "server/retention/reclaimer.h"
#include "server/retention/retention.h"

namespace tessera {

struct CollectorOptions {
  // A blob is removed if no pass during this running time found a reference to it and its file is as old. A blob is
  // stored before the report that refers to it.
  double grace_s = 3600;
  double keep_quarantined_s = 0;  // how long quarantined blobs are kept for inspection; 0: for ever
  // Above this size quarantined blobs are removed, oldest first, then intermediate results of ended jobs, oldest job
  // first; 0: no limit.
  int64_t limit_bytes = 0;
  std::set<std::string> keep = {};  // SHA-256 of blobs that stay without a reference
};

struct Collected {
  int64_t files = 0;
  int64_t bytes = 0;
  int64_t bytes_left = 0;
};

// Mark and sweep beside the coordinator's other work. Not thread-safe: call Pass from one thread.
class BlobCollector {
 public:
  // All pointers must outlive the collector.
  BlobCollector(Reclaimer* reclaimer, const BlobStore* blobs, const Clock* clock, const CollectorOptions& options)
      : reclaimer_(reclaimer),
        blobs_(blobs),
        clock_(clock),
        options_(options),
        quarantine_retention_(options.keep_quarantined_s) {}
  // One pass over all files. Ends early if `stop` returns true. Returns the errors of removal.
  StatusOr<Collected> Pass(const std::function<bool()>& stop = {});

 private:
  // Removes the expired blobs from the list and returns them.
  std::vector<BlobEntry> TakeExpired(std::vector<BlobEntry>& quarantined);

  Reclaimer* const reclaimer_;
  const BlobStore* const blobs_;
  const Clock* const clock_;
  const CollectorOptions options_;
  Retention quarantine_retention_;
  absl::flat_hash_map<std::string, int64_t> unneeded_since_us_;  // by BlobEntry::name, on the monotonic clock
};

}  // namespace tessera
