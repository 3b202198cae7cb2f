// Removes blobs that no job refers to any more, damaged ones that were kept for long enough, and spare ones where they
// take too much room.
#ifndef TESSERA_SERVER_RETENTION_BLOB_COLLECTOR_H_
#define TESSERA_SERVER_RETENTION_BLOB_COLLECTOR_H_

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
  // A blob goes when nobody has referred to it at every look of so much running time, and its file is that old: it is
  // stored before the report that names it.
  double grace_s = 3600;
  double leftover_s = 86400;      // the same for what unfinished writes left
  double keep_quarantined_s = 0;  // damaged blobs, for whom it concerns to see; 0: for ever
  // Above so many bytes in the folder, damaged blobs go, the oldest first, then what tasks of ended jobs handed to each
  // other, oldest ended jobs first; 0: no limit.
  int64_t limit_bytes = 0;
};

struct Collected {
  int64_t files = 0;
  int64_t bytes = 0;
  int64_t bytes_left = 0;
};

// Marks and sweeps beside the coordinator's work, which waits for none of it. Not thread-safe: one thread calls Pass.
class BlobCollector {
 public:
  // All must outlive the collector.
  BlobCollector(Reclaimer* reclaimer, const BlobStore* blobs, const Clock* clock, const CollectorOptions& options)
      : reclaimer_(reclaimer),
        blobs_(blobs),
        clock_(clock),
        options_(options),
        quarantine_retention_(options.keep_quarantined_s) {}
  // Once over all files. Stops early where `stop` says so.
  StatusOr<Collected> Pass(const std::function<bool()>& stop = {});

 private:
  // Those that have been kept for long enough, off the list.
  std::vector<BlobFile> TakeExpired(std::vector<BlobFile>& quarantined);

  Reclaimer* const reclaimer_;
  const BlobStore* const blobs_;
  const Clock* const clock_;
  const CollectorOptions options_;
  Retention quarantine_retention_;
  absl::flat_hash_map<std::string, int64_t> unneeded_since_us_;  // paths, on the monotonic clock
};

}  // namespace tessera

#endif  // TESSERA_SERVER_RETENTION_BLOB_COLLECTOR_H_
