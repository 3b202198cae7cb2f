// The coordinator's storage interfaces: an append-only list of records, and a cache of file digests.
#pragma once

#include <functional>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"

namespace tessera {

// Which failures a stored record survives.
enum class Durability {
  kProcess,  // a crash of the process; a failure of the machine may lose the last of these records
  kMachine,  // a failure of the machine; the same then holds for all earlier records
};

// A record as read from the store. Numbers begin at 1.
struct StoredRecord {
  int64_t number = 0;
  StatusOr<std::string> content;  // DATA_LOSS if it is damaged or missing
};

// The job that a record belongs to.
struct RecordOwner {
  int job = -1;          // index of the job; -1: no job
  bool deletes = false;  // the record deletes the job: it is kept, and the job's other records may be removed
};
// Reads the owner from a record's content. Must be deterministic and thread-safe.
using OwnerOf = std::function<RecordOwner(std::string_view content)>;

// State changes in order. After a failure only records at the end of the list can be missing. Thread-safe.
class RecordStore {
 public:
  virtual ~RecordStore() = default;
  // Stores all of the records or, on error, none.
  virtual Status Append(const std::vector<std::string_view>& records, Durability durability) = 0;
  // Calls `visit` for every record, oldest first, except quarantined records and those of deleted jobs. Returns errors
  // of the store as a whole; a damaged record is passed to `visit`.
  virtual Status Replay(const std::function<void(const StoredRecord& record)>& visit) = 0;
  // Quarantines the record: keeps it with the reason, but never visits it again.
  virtual Status Quarantine(int64_t number, const std::string& reason) = 0;
  // Jobs with a stored deletion record.
  virtual StatusOr<std::set<int>> DeletedJobs() = 0;
  // Removes at most `max_records` records of deleted jobs. Returns how many; 0: none is left.
  virtual StatusOr<int> RemoveRecords(int max_records) = 0;
  // How often this store was opened, including this time. The same number is never returned by two openings.
  virtual int64_t StartCount() const = 0;
};

// Caches the digest of a file while its size and modification time stay the same. Thread-safe.
class DigestCache {
 public:
  virtual ~DigestCache() = default;
  virtual std::optional<Digest> Find(const std::string& path, const FileStamp& stamp) = 0;
  virtual Status Remember(const std::string& path, const FileStamp& stamp, const Digest& digest) = 0;
};

}  // namespace tessera
