#include "server/retention/reclaimer.h"

#include <algorithm>
#include <shared_mutex>
#include <string>
#include <utility>

#include "server/jobs/job_records.h"

namespace tessera {
namespace {

constexpr int kTasksAtOnce = 256;                          // per hold of the mutex
constexpr size_t kRemovedAtOnce = 64;                      // files per hold of BlobUse::mutex
constexpr int kFreedTasks = 1000, kRemovedRecords = 1000;  // per step

}  // namespace

// Releases the mutex after a few tasks, because a city has millions. References that change between two holds are in
// BlobUse::since, which RemoveBlobs checks.
BlobReferences Reclaimer::CollectReferences() {
  BlobReferences references;
  {
    std::lock_guard lock(mutex_);
    core_.blob_use().since.Start();
  }
  // New references are noted from now on, so jobs may change between the steps.
  for (int job = 0, task = 0;; ++job, task = 0) {
    for (bool more = true; more;) {
      std::lock_guard lock(mutex_);
      if (job >= static_cast<int>(ledger_.jobs().size())) return references;
      const Job& of = ledger_.jobs()[job];
      if (of.deleted) break;
      if (task == 0) references.AddJob(of);
      const int end = std::min(task + kTasksAtOnce, static_cast<int>(of.tasks.size()));
      for (; task < end; ++task) references.AddOutputs(of.header, HasTasksToRun(ledger_, job), of.tasks[task].outputs);
      more = task < static_cast<int>(of.tasks.size());
    }
  }
}

StatusOr<std::vector<BlobEntry>> Reclaimer::RemoveBlobs(const std::vector<BlobEntry>& files) {
  std::vector<BlobEntry> gone;
  for (size_t next = 0; next < files.size();) {
    BlobStore::Removed removed;
    {
      const std::unique_lock nobody_refers(core_.blob_use().mutex);
      std::vector<BlobEntry> unused;
      {
        std::lock_guard lock(mutex_);
        if (!core_.blob_use().since.started())
          return absl::FailedPreconditionError("cannot remove blobs: CollectReferences has not run since the start");
        for (const size_t end = std::min(next + kRemovedAtOnce, files.size()); next < end; ++next) {
          const BlobEntry& file = files[next];
          if (file.kind == BlobEntry::Kind::kBlob && core_.blob_use().since.Contains(file.sha256)) continue;
          unused.push_back(file);
        }
      }
      auto result = environment_.blobs->RemoveAll(unused, may_remove_);
      if (absl::IsCancelled(result.status())) return gone;
      TESSERA_RETURN_IF_ERROR(result.status());
      removed = *std::move(result);
    }
    removed.free_bytes();
    gone.insert(gone.end(), removed.entries.begin(), removed.entries.end());
  }
  return gone;
}

StatusOr<bool> Reclaimer::FreeDeleted() {
  bool more = false;
  {
    std::lock_guard lock(mutex_);
    more = ledger_.FreeDeleted(kFreedTasks);
  }
  TESSERA_ASSIGN_OR_RETURN(const int removed, environment_.store->RemoveRecords(kRemovedRecords));
  return more || removed > 0;
}

StatusOr<int> Reclaimer::DeleteExpired(Retention& retention) {
  std::vector<KeptThing> ended;
  {
    std::lock_guard lock(mutex_);
    for (int job = 0; job < static_cast<int>(ledger_.jobs().size()); ++job) {
      const JobHeader& header = ledger_.jobs()[job].header;
      if (!ledger_.jobs()[job].deleted && HasEnded(header.state)) ended.push_back({header.name, header.end_us});
    }
  }
  const std::vector<int> expired =
      retention.Expired(ended, environment_.clock->UnixTimeUs(), environment_.clock->MonotonicUs());
  int deleted = 0;
  // Newest first: an update is newer than its base.
  for (auto place = expired.rbegin(); place != expired.rend(); ++place) {
    const auto& [name, end_us] = ended[*place];
    std::lock_guard lock(mutex_);
    const auto job = ledger_.FindJob(name);
    if (!job.ok() || ledger_.jobs()[*job].header.end_us != end_us) continue;  // retried
    const Status status = CommitDeletion(core_, name, "its retention time is over");
    if (absl::IsFailedPrecondition(status)) continue;  // base of another job
    TESSERA_RETURN_IF_ERROR(status);
    ++deleted;
  }
  if (deleted > 0) TESSERA_RETURN_IF_ERROR(core_.Durable());
  return deleted;
}

}  // namespace tessera
