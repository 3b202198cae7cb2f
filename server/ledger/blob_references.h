// Which blobs the jobs that are kept refer to.
#ifndef TESSERA_SERVER_LEDGER_BLOB_REFERENCES_H_
#define TESSERA_SERVER_LEDGER_BLOB_REFERENCES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"
#include "absl/types/span.h"
#include "server/ledger/job.h"

namespace tessera {

// Digests by their first 64 bits: a city has millions. That two share them keeps a blob that could go, no more.
// Not thread-safe.
class BlobReferences {
 public:
  static uint64_t IdOf(const std::string& sha256);

  // What the job published, and the classifier that it was given.
  void AddJob(const Job& job);
  // `runs`: whether tasks of the job may run: Ledger::Runs.
  void AddOutputs(const JobHeader& job, bool runs, absl::Span<const StoredFile> outputs);

  // By a job that runs, or what is read of one that does not: artifacts, and what updates go on from.
  bool Needs(uint64_t id) const { return needed_.contains(id); }
  // Only by jobs that do not run, as what tasks handed to each other: when the last of them ended (Unix time, us), else
  // -1. It can be made again.
  int64_t SpareSince(uint64_t id) const;

 private:
  absl::flat_hash_set<uint64_t> needed_;
  absl::flat_hash_map<uint64_t, int64_t> spare_;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_LEDGER_BLOB_REFERENCES_H_
