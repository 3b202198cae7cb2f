// The thread that deletes old jobs and removes memory, records and blobs that no job needs.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

#include "server/retention/blob_collector.h"
#include "server/retention/reclaimer.h"
#include "server/retention/retention.h"

namespace tessera {

struct KeeperOptions {
  double keep_s = 0;  // how long ended jobs are kept; 0: for ever
  CollectorOptions collector;
};

// Runs from construction to destruction. Logs errors and retries.
class Keeper {
 public:
  // All arguments must outlive the keeper.
  Keeper(DispatchCore& core, const BlobStore* blobs, const Clock* clock, const KeeperOptions& options);
  ~Keeper();

 private:
  void Run();
  void LookAtJobs();
  void LookAtBlobs();
  bool stopped();

  Reclaimer reclaimer_;
  Retention retention_;
  BlobCollector collector_;
  std::mutex mutex_;
  std::condition_variable stop_;
  bool stopped_ = false;
  std::thread thread_;  // last: uses all others
};

}  // namespace tessera
