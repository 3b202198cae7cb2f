// Which blobs the jobs that are kept refer to, and which they came to refer to lately.
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

// Keeps the first 64 bits of each digest, because a city has millions. A collision only keeps a blob that is not
// needed. Not thread-safe.
class BlobReferences {
 public:
  static uint64_t IdOf(const std::string& sha256);

  // What the job published, and the classifier that it was given.
  void AddJob(const Job& job);
  // `runs`: whether tasks of the job may run: Ledger::Runs.
  void AddOutputs(const JobHeader& job, bool runs, absl::Span<const StoredFile> outputs);

  // Whether a job that runs needs it, or it is an artifact or base data of a job that does not.
  bool Needs(uint64_t id) const { return needed_.contains(id); }
  // If only tasks of jobs that do not run read it: when the last of these jobs ended (Unix time, us), else -1. Such a
  // blob can be made again.
  int64_t SpareSince(uint64_t id) const;

 private:
  absl::flat_hash_set<uint64_t> needed_;
  absl::flat_hash_map<uint64_t, int64_t> spare_;
};

// Blobs that records, and jobs that run again, have come to refer to since Start. Not thread-safe.
class NewReferences {
 public:
  // Forgets what was noted before. Before the first call nothing is noted.
  void Start() { noted_.emplace(); }
  bool started() const { return noted_.has_value(); }
  // `record`: applied to the ledger.
  void Note(const v1::Record& record, const Ledger& ledger);
  bool Contains(const std::string& sha256) const {
    return noted_ && noted_->blobs.contains(BlobReferences::IdOf(sha256));
  }

 private:
  struct Noted {
    absl::flat_hash_set<uint64_t> blobs;  // BlobReferences::IdOf
    std::set<int> jobs;                   // whose outputs are all among these
  };
  std::optional<Noted> noted_;
};

struct BlobUse {
  // Held shared while a change refers to blobs that may be stored already, exclusively while blobs are removed. Taken
  // before the mutex of the ledger.
  std::shared_mutex mutex;
  NewReferences since;  // guarded by the mutex of the ledger
};

}  // namespace tessera
