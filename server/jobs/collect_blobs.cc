// What a collector of blobs asks of the coordinator: what is referred to, and to remove what is not.
#include <algorithm>
#include <cstdio>

#include "server/jobs/dispatcher.h"
#include "server/ledger/record_owner.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr int kTasksAtOnce = 256;      // under the mutex
constexpr size_t kRemovedAtOnce = 64;  // files, while reports wait

}  // namespace

BlobReferences Dispatcher::CollectReferences() {
  BlobReferences references;
  {
    std::lock_guard lock(mutex_);
    referred_since_.emplace();
  }
  // What is referred to from now on is noted, so that jobs may change while they are gone through.
  for (int job = 0, task = 0;; ++job, task = 0) {
    for (bool more = true; more;) {
      std::lock_guard lock(mutex_);
      if (job >= static_cast<int>(ledger_.jobs().size())) return references;
      const Job& of = ledger_.jobs()[job];
      if (of.deleted) break;
      if (task == 0) references.AddJob(of);
      const int end = std::min(task + kTasksAtOnce, static_cast<int>(of.tasks.size()));
      for (; task < end; ++task) references.AddOutputs(of.header, ledger_.Runs(job), of.tasks[task].outputs);
      more = task < static_cast<int>(of.tasks.size());
    }
  }
}

void Dispatcher::NoteReferencesLocked(const v1::Record& record) {
  if (!referred_since_) return;
  const auto note = [&](const auto& files) {
    for (const auto& file : files) referred_since_->blobs.insert(BlobReferences::IdOf(file.digest().sha256()));
  };
  note(record.task_succeeded().outputs());
  note(record.job_ended().artifacts());
  for (const auto& task : record.tasks_planned().tasks()) note(task.given());
  for (const auto& file : record.job_accepted().scene_files()) {
    if (file.path() == kClassifierFile) referred_since_->blobs.insert(BlobReferences::IdOf(file.digest().sha256()));
  }
  // A job that had ended runs again: what could be spared of it cannot any more.
  const int job = record.has_job_retried() || record.has_result_lost() ? JobOf(record) : -1;
  if (job < 0 || !referred_since_->jobs.insert(job).second) return;
  for (const JobTask& task : ledger_.jobs()[job].tasks) {
    for (const StoredFile& file : task.outputs) referred_since_->blobs.insert(BlobReferences::IdOf(file.sha256.Hex()));
  }
}

StatusOr<std::vector<BlobFile>> Dispatcher::RemoveBlobs(const std::vector<BlobFile>& files) {
  std::vector<BlobFile> gone;
  for (size_t next = 0; next < files.size();) {
    std::vector<std::string> taken;
    {
      const std::unique_lock nobody_refers(blobs_mutex_);
      const size_t end = std::min(next + kRemovedAtOnce, files.size());
      for (; next < end; ++next) {
        const BlobFile& file = files[next];
        {
          std::lock_guard lock(mutex_);
          if (!referred_since_) return absl::FailedPreconditionError("references were not collected");
          if (file.kind == BlobFile::Kind::kBlob && referred_since_->blobs.contains(BlobReferences::IdOf(file.sha256)))
            continue;
        }
        StatusOr<std::string> out = TakeOut(environment_.blobs->root(), file);
        if (absl::IsNotFound(out.status())) continue;
        TESSERA_RETURN_IF_ERROR(out.status());
        taken.push_back(*std::move(out));
        gone.push_back(file);
      }
    }
    for (const std::string& path : taken) std::remove(path.c_str());
  }
  return gone;
}

}  // namespace tessera
