// What the coordinator keeps: an append-only list of records, and the digests of files it has hashed before.
#ifndef TESSERA_SERVER_STORE_RECORD_STORE_H_
#define TESSERA_SERVER_STORE_RECORD_STORE_H_

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

// What a record outlives from the moment on that it is stored.
enum class Durability {
  kProcess,  // the process's end, however it comes; if the machine fails the last of these may be lost
  kMachine,  // the machine's too, and so do all records before it
};

// A record as it is found, counted from 1.
struct StoredRecord {
  int64_t number = 0;
  StatusOr<std::string> content;  // DATA_LOSS if it is damaged or missing
};

// Whose a record is.
struct RecordOwner {
  int job = -1;          // its index; -1: nobody's
  bool deletes = false;  // the record says that the job is deleted: it is kept itself, and ends the life of the job's
};
// Reads that from a record's content. Must give the same at every time. Thread-safe.
using OwnerOf = std::function<RecordOwner(std::string_view content)>;

// State changes in the order they happened; whatever is lost, it is the end of the list. Thread-safe.
class RecordStore {
 public:
  virtual ~RecordStore() = default;
  // All of the records or, on error, none.
  virtual Status Append(const std::vector<std::string_view>& records, Durability durability) = 0;
  // Calls `visit` for every record that was not set aside, but those of deleted jobs, oldest first. Errors are those of
  // the store as a whole.
  virtual Status Replay(const std::function<void(const StoredRecord& record)>& visit) = 0;
  // Keeps the record, with the reason, but never visits it again.
  virtual Status SetAside(int64_t number, const std::string& reason) = 0;
  // Jobs whose deletion is stored.
  virtual StatusOr<std::set<int>> DeletedJobs() = 0;
  // Frees the space of at most so many records of deleted jobs. Gives how many; 0: none is left.
  virtual StatusOr<int> RemoveRecords(int max_records) = 0;
  // How often this store was opened, this time included; the same number is never given twice.
  virtual int64_t StartCount() const = 0;
};

// Remembers the digest of a file as long as the file's size and time of change stay. Thread-safe.
class DigestCache {
 public:
  virtual ~DigestCache() = default;
  virtual std::optional<Digest> Find(const std::string& path, const FileStamp& stamp) = 0;
  virtual Status Remember(const std::string& path, const FileStamp& stamp, const Digest& digest) = 0;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_STORE_RECORD_STORE_H_
