#include "server/retention/retention_loop.h"

#include <chrono>
#include <string>

#include "common/log/log.h"

namespace tessera {
namespace {

using Steady = std::chrono::steady_clock;

constexpr std::chrono::seconds kFreeInterval{1}, kJobsInterval{60}, kBlobsInterval{600};
constexpr std::chrono::milliseconds kFreePause{5};  // pause between steps, for other threads

}  // namespace

RetentionLoop::RetentionLoop(DispatchCore& core, const BlobStore* blobs, const Clock* clock,
                             const RetentionOptions& options)
    : reclaimer_(core, options.may_remove_blobs),
      retention_(options.keep_s),
      collector_(&reclaimer_, blobs, clock, options.collector),
      thread_([this] { Run(); }) {}

RetentionLoop::~RetentionLoop() {
  {
    std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  stop_.notify_all();
  thread_.join();
}

bool RetentionLoop::stopped() {
  std::lock_guard lock(mutex_);
  return stopped_;
}

void RetentionLoop::Run() {
  auto next_jobs = Steady::now(), next_blobs = next_jobs;
  std::string last_error;
  while (!stopped()) {
    const StatusOr<bool> more = reclaimer_.FreeDeleted();
    const std::string error = more.ok() ? "" : std::string(more.status().message());
    if (!error.empty() && error != last_error) {
      LogEvent(LogLevel::kWarning, "cannot remove records of deleted jobs, will retry", {{"reason", error}});
    }
    last_error = error;
    if (Steady::now() >= next_jobs) DeleteJobs(), next_jobs = Steady::now() + kJobsInterval;
    if (Steady::now() >= next_blobs) CollectBlobs(), next_blobs = Steady::now() + kBlobsInterval;
    std::unique_lock lock(mutex_);
    const std::chrono::milliseconds pause = more.ok() && *more ? kFreePause : kFreeInterval;
    stop_.wait_for(lock, pause, [&] { return stopped_; });
  }
}

void RetentionLoop::DeleteJobs() {
  const StatusOr<int> deleted = reclaimer_.DeleteExpired(retention_);
  if (deleted.ok()) return;
  LogEvent(LogLevel::kWarning, "cannot delete expired jobs, will retry",
           {{"reason", std::string(deleted.status().message())}});
}

void RetentionLoop::CollectBlobs() {
  const StatusOr<Collected> collected = collector_.Pass([this] { return stopped(); });
  if (!collected.ok()) {
    LogEvent(LogLevel::kWarning, "cannot collect blobs, will retry",
             {{"reason", std::string(collected.status().message())}});
  } else if (collected->files > 0) {
    LogEvent(LogLevel::kInfo, "blobs collected",
             {{"files", std::to_string(collected->files)},
              {"bytes", std::to_string(collected->bytes)},
              {"bytes_left", std::to_string(collected->bytes_left)}});
  }
}

}  // namespace tessera
