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

struct RetentionOptions {
  double keep_s = 0;  // how long ended jobs are kept; 0: for ever
  CollectorOptions collector;
  std::function<bool()> may_remove_blobs = {};  // of Reclaimer
};

// Runs from construction to destruction. Logs errors and retries.
class RetentionLoop {
 public:
  // All arguments must outlive the loop.
  RetentionLoop(DispatchCore& core, const BlobStore* blobs, const Clock* clock, const RetentionOptions& options);
  ~RetentionLoop();

 private:
  void Run();
  void DeleteJobs();
  void CollectBlobs();
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
