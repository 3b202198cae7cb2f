// What the coordinator keeps: an append-only list of records, and the digests of files it has hashed before.
#ifndef TESSERA_SERVER_STORE_RECORD_STORE_H_
#define TESSERA_SERVER_STORE_RECORD_STORE_H_

#include <functional>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "common/storage/files.h"
#include "common/storage/hash.h"

namespace tessera {

// What a record outlives from the moment on that it is stored.
enum class Durability {
  kProcess,  // the process's end, however it comes; if the machine fails the last of these may be lost
  kMachine,  // the machine's too, and so do all records before it
};

// State changes in the order they happened; whatever is lost, it is the end of the list. Thread-safe.
class RecordStore {
 public:
  virtual ~RecordStore() = default;
  // On error nothing was stored.
  virtual Status Append(const std::string& record, Durability durability) = 0;
  // Calls `visit` for every record, oldest first; stops at its first error and returns it. DATA_LOSS names the record
  // that cannot be read.
  virtual Status Replay(const std::function<Status(const std::string& record)>& visit) = 0;
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
