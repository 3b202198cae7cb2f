// Removes blobs that no job refers to, quarantined blobs that have expired, and spare ones if the folder is too large.
#pragma once

#include <cstdint>
#include <functional>
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
  // A blob is removed if no job referred to it in any pass during this running time, and its file is that old: a blob
  // is stored before the report that names it.
  double grace_s = 3600;
  double keep_quarantined_s = 0;  // quarantined blobs, which are kept for inspection; 0: for ever
  // If the folder has more bytes, quarantined blobs are removed, the oldest first, then blobs that only tasks of ended
  // jobs read, of the oldest jobs first; 0: no limit.
  int64_t limit_bytes = 0;
};

struct Collected {
  int64_t files = 0;
  int64_t bytes = 0;
  int64_t bytes_left = 0;
};

// Marks and sweeps; the coordinator's other work does not wait for it. Not thread-safe: one thread calls Pass.
class BlobCollector {
 public:
  // All must outlive the collector.
  BlobCollector(Reclaimer* reclaimer, const BlobStore* blobs, const Clock* clock, const CollectorOptions& options)
      : reclaimer_(reclaimer),
        blobs_(blobs),
        clock_(clock),
        options_(options),
        quarantine_retention_(options.keep_quarantined_s) {}
  // One pass over all files. Ends early if `stop` returns true.
  StatusOr<Collected> Pass(const std::function<bool()>& stop = {});

 private:
  // Takes those that have expired off the list.
  std::vector<BlobEntry> TakeExpired(std::vector<BlobEntry>& quarantined);

  Reclaimer* const reclaimer_;
  const BlobStore* const blobs_;
  const Clock* const clock_;
  const CollectorOptions options_;
  Retention quarantine_retention_;
  absl::flat_hash_map<std::string, int64_t> unneeded_since_us_;  // by BlobEntry::name, on the monotonic clock
};

}  // namespace tessera
