#include "server/retention/verify_state.h"

#include <utility>

#include "absl/container/flat_hash_set.h"
#include "common/base/version.h"
#include "server/ledger/blob_references.h"
#include "server/ledger/ledger.h"
#include "server/ledger/restore_ledger.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

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
  absl::flat_hash_set<uint64_t> seen;
  const auto check = [&](const std::string& whose, const NamedDigest& file, bool remaking) {
    const uint64_t id = BlobReferences::IdOf(file.digest.sha256);
    if (!seen.insert(id).second) return;
    ++summary.blobs;
    const Status status = deep || !blobs.Has(file.digest) ? blobs.VerifyOrQuarantine(file.digest) : absl::OkStatus();
    if (status.ok()) return;
    if (absl::IsNotFound(status) && (remaking || references.SpareSince(id) >= 0)) {
      ++summary.spare;
    } else {
      fault(whose + ", " + file.name + ": " + std::string(status.message()));
    }
  };
  for (const Job& job : ledger.jobs()) {
    if (job.deleted) continue;
    for (const NamedDigest& artifact : job.artifacts) check(job.header.name, artifact, false);
    for (const NamedDigest& file : job.scene_files) {
      if (file.name == kClassifierFile) check(job.header.name, file, false);
    }
    for (const JobTask& task : job.tasks) {
      for (const StoredFile& output : task.outputs) {
        check(job.header.name + ", '" + task.plan.name + "'", output, task.remaking);
      }
    }
  }
  return summary;
}

}  // namespace tessera
