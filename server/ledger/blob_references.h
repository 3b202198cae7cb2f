// The blobs that jobs refer to, and the references added since a collection started.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <shared_mutex>
#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"
#include "absl/types/span.h"
#include "server/ledger/job.h"

namespace tessera {

namespace v1 {
class Record;
}  // namespace v1
class Ledger;

// The blobs that jobs refer to. Stores 64 bits of each digest, because a city has millions; a collision keeps a blob
// that is not needed. Not thread-safe.
class BlobReferences {
 public:
  static uint64_t IdOf(const std::string& sha256);

  // Adds the job's artifacts and its classifier.
  void AddJob(const Job& job);
  // Adds the outputs of a task. `runs`: HasTasksToRun of its job.
  void AddOutputs(const JobHeader& job, bool runs, absl::Span<const StoredFile> outputs);

  // Whether a running job refers to the blob, or it is an artifact or base data of an ended one.
  bool Needs(uint64_t id) const { return needed_.contains(id); }
  // Unix time (us) at which the last job that refers to the blob ended, if only intermediate outputs of ended jobs do;
  // else -1. Such a blob can be recomputed.
  int64_t SpareSince(uint64_t id) const;

 private:
  absl::flat_hash_set<uint64_t> needed_;
  absl::flat_hash_map<uint64_t, int64_t> spare_;
};

// Whether the job is active, or lost results of it are being recomputed.
bool HasTasksToRun(const Ledger& ledger, int job);

// Blobs to which new records, and ended jobs that run again, refer since Start. Not thread-safe.
class NewReferences {
 public:
  // Drops all notes. Note does nothing before the first call.
  void Start() { noted_.emplace(); }
  bool started() const { return noted_.has_value(); }
  // `record`: already applied to the ledger.
  void Note(const v1::Record& record, const Ledger& ledger);
  bool Contains(const std::string& sha256) const {
    return noted_ && noted_->blobs.contains(BlobReferences::IdOf(sha256));
  }

 private:
  struct Noted {
    absl::flat_hash_set<uint64_t> blobs;  // BlobReferences::IdOf
    std::set<int> jobs;                   // jobs of which all outputs are in `blobs`
  };
  std::optional<Noted> noted_;
};

struct BlobUse {
  // Held shared while a change adds references to stored blobs, exclusively while blobs are removed. Lock order: before
  // the mutex of the ledger.
  std::shared_mutex mutex;
  NewReferences since;  // guarded by the mutex of the ledger
};

}  // namespace tessera
