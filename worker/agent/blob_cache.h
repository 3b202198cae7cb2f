// The worker's local cache of blobs, with least-recently-used eviction.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>

#include "common/base/status.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"

namespace tessera {

// A folder with at most `max_bytes` of blobs; the inputs of a running task may exceed the limit until it ends. The
// content survives restarts. A blob of an earlier process, or with a changed file, is verified before its next use.
// Thread-safe; one process per folder.
class BlobCache {
 public:
  static StatusOr<std::unique_ptr<BlobCache>> Open(const std::string& root, int64_t max_bytes);

  // Stores the blob `digest` in `store`.
  using Fetcher = std::function<Status(const Digest& digest, BlobStore& store)>;

  // Path of the blob. Fetches it if it is missing or damaged. The blob is in use, and not evicted, until Release.
  // Several calls fetch at once, but never the same blob.
  StatusOr<std::string> Get(const Digest& digest, const Fetcher& fetch);

  // Moves a file into the cache. The caller has verified that it hashes to `digest`.
  Status Adopt(const std::string& path, const Digest& digest);

  // Marks all blobs as unused and evicts down to the limit.
  void Release();

  int64_t size_bytes() const;
  bool Holds(const Digest& digest) const;

 private:
  class Turn;
  struct Entry {
    int64_t size_bytes = 0;
    int64_t last_use = 0;  // order of use
    FileStamp stamp = {};  // at its last verification or write by this process; default: none
  };

  BlobCache(std::unique_ptr<FolderBlobs> store, int64_t max_bytes) : store_(std::move(store)), max_bytes_(max_bytes) {}
  std::string PathOf(const Digest& digest) const;
  // Functions named ...Locked need the mutex.
  void InsertLocked(const Digest& digest);
  void RemoveLocked(const std::string& sha256);
  // Removes least recently used blobs that are not in use, until the blobs being fetched and `incoming_bytes` more fit.
  void MakeRoomLocked(int64_t incoming_bytes);

  std::unique_ptr<FolderBlobs> store_;
  const int64_t max_bytes_;
  mutable std::mutex mutex_;              // of all below; not held while a blob is read, fetched or moved
  std::condition_variable changed_;       // of busy_
  std::map<std::string, Entry> entries_;  // by SHA-256
  std::set<std::string> in_use_;
  std::set<std::string> busy_;  // blobs that a call verifies, fetches or moves
  int64_t size_bytes_ = 0;
  int64_t incoming_bytes_ = 0;  // of blobs being fetched
  int64_t uses_ = 0;
};

}  // namespace tessera
