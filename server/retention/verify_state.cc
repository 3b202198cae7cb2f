#include "server/retention/verify_state.h"

#include <utility>

#include "absl/container/flat_hash_set.h"
#include "common/base/version.h"
#include "server/ledger/blob_references.h"
#include "server/ledger/ledger.h"
#include "server/ledger/read_records.h"
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
  TESSERA_ASSIGN_OR_RETURN(std::set<int> deleted, store.DeletedJobs());
  ledger.ExpectDeleted(std::move(deleted));
  TESSERA_RETURN_IF_ERROR(ReadRecords(store, [&](int64_t number, Status status, const v1::Record& record) {
    if (status.ok()) status = ledger.Check(record);
    if (!status.ok()) {
      return fault("record " + std::to_string(number) + ": " + std::string(status.message()) +
                   " (the jobs that need it fail)");
    }
    ledger.Apply(record);
    ++summary.records;
  }));
  ledger.EndReplay();
  BlobReferences references;
  for (int index = 0; index < static_cast<int>(ledger.jobs().size()); ++index) {
    const Job& job = ledger.jobs()[index];
    if (job.deleted) continue;
    ++summary.jobs;
    references.AddJob(job);
    for (const JobTask& task : job.tasks) references.AddOutputs(job.header, ledger.Runs(index), task.outputs);
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
    for (const NamedDigest& artifact : job.header.artifacts) check(job.header.name, artifact, false);
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
