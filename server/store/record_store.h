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

// State changes in the order they happened. Thread-safe.
class RecordStore {
 public:
  virtual ~RecordStore() = default;
  // Once OK the record survives any crash. On error nothing was stored.
  virtual Status Append(const std::string& record) = 0;
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
