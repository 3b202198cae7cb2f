#include "server/retention/verify_state.h"

#include <utility>
#include <vector>

#include "absl/container/flat_hash_set.h"
#include "common/base/parallel.h"
#include "common/base/version.h"
#include "server/ledger/blob_references.h"
#include "server/ledger/ledger.h"
#include "server/ledger/restore_ledger.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

constexpr size_t kFilesAtOnce = 1000;  // asked for together, and held in memory

}  // namespace

StatusOr<StateSummary> VerifyState(RecordStore& store, BlobStore& blobs, bool deep,
                                   const std::function<void(const std::string& fault)>& tell) {
  StateSummary summary;
  const auto fault = [&](const std::string& what) {
    ++summary.faults;
    tell(what);
  };
  Ledger ledger(kAlgorithmVersion);
  TESSERA_ASSIGN_OR_RETURN(summary.records,
                           RestoreLedger(store, ledger, [&](int64_t number, const Status& reason, const v1::Record&) {
                             fault("record " + std::to_string(number) + ": " + std::string(reason.message()) +
                                   " (the jobs that need it fail)");
                           }));
  BlobReferences references;
  for (int index = 0; index < static_cast<int>(ledger.jobs().size()); ++index) {
    const Job& job = ledger.jobs()[index];
    if (job.deleted) continue;
    ++summary.jobs;
    references.AddJob(job);
    for (const JobTask& task : job.tasks) references.AddOutputs(job.header, HasTasksToRun(ledger, index), task.outputs);
  }
  struct File {
    std::string whose, name;
    Digest digest;
    bool remaking = false;
  };
  absl::flat_hash_set<uint64_t> seen;
  std::vector<File> files;  // not checked yet
  const auto check = [&] {
    std::vector<Status> found(files.size());
    ConcurrentForEach(static_cast<int64_t>(files.size()), BlobStore::kCallsAtOnce, [&](int64_t i) {
      const Digest& digest = files[i].digest;
      found[i] = deep || !blobs.Has(digest) ? blobs.VerifyOrQuarantine(digest) : absl::OkStatus();
    });
    for (size_t i = 0; i < files.size(); ++i) {
      if (found[i].ok()) continue;
      const bool spare = files[i].remaking || references.SpareSince(BlobReferences::IdOf(files[i].digest.sha256)) >= 0;
      if (absl::IsNotFound(found[i]) && spare) {
        ++summary.spare;
      } else {
        fault(files[i].whose + ", " + files[i].name + ": " + std::string(found[i].message()));
      }
    }
    files.clear();
  };
  const auto add = [&](const std::string& whose, const NamedDigest& file, bool remaking) {
    if (!seen.insert(BlobReferences::IdOf(file.digest.sha256)).second) return;
    ++summary.blobs;
    files.push_back({whose, file.name, file.digest, remaking});
    if (files.size() == kFilesAtOnce) check();
  };
  for (const Job& job : ledger.jobs()) {
    if (job.deleted) continue;
    for (const NamedDigest& artifact : job.artifacts) add(job.header.name, artifact, false);
    for (const NamedDigest& file : job.scene_files) {
      if (file.name == kClassifierFile) add(job.header.name, file, false);
    }
    for (const JobTask& task : job.tasks) {
      for (const StoredFile& output : task.outputs) {
        add(job.header.name + ", '" + task.plan.name + "'", output, task.remaking);
      }
    }
  }
  check();
  return summary;
}

}  // namespace tessera
