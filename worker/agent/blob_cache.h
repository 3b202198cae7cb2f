// The worker's own copies of blobs, the least recently used of which give way to new ones.
#ifndef TESSERA_WORKER_AGENT_BLOB_CACHE_H_
#define TESSERA_WORKER_AGENT_BLOB_CACHE_H_

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "common/base/status.h"
#include "common/storage/blob_store.h"
#include "common/storage/files.h"

namespace tessera {

// A folder of at most `max_bytes` of blobs (what a running task needs may exceed it until the task ends). Keeps its
// content over restarts; what an earlier process left, or somebody changed, is hashed before its next use. Not
// thread-safe; one process a folder.
class BlobCache {
 public:
  static StatusOr<std::unique_ptr<BlobCache>> Open(const std::string& root, int64_t max_bytes);

  // Brings the bytes of `digest` into the store given.
  using Fetcher = std::function<Status(const Digest& digest, BlobStore& store)>;

  // Path of the blob, fetched if it is not here (or no longer what it was). It stays until Release.
  StatusOr<std::string> Get(const Digest& digest, const Fetcher& fetch);

  // Takes a file that hashes to `digest` (known to the caller) into the cache; it is moved away from `path`.
  Status Adopt(const std::string& path, const Digest& digest);

  // Nothing is in use any more: shrinks to the bound.
  void Release();

  int64_t size_bytes() const { return size_bytes_; }
  bool Holds(const Digest& digest) const { return entries_.contains(digest.sha256); }

 private:
  struct Entry {
    int64_t size_bytes = 0;
    int64_t last_use = 0;  // order of use
    FileStamp stamp = {};  // when this process last knew its content; none: not yet
  };

  BlobCache(std::unique_ptr<BlobStore> store, int64_t max_bytes) : store_(std::move(store)), max_bytes_(max_bytes) {}
  void Insert(const Digest& digest);
  void Remove(const std::string& sha256);
  // Drops what was used longest ago and is not in use, until `incoming_bytes` more fit.
  void MakeRoom(int64_t incoming_bytes);

  std::unique_ptr<BlobStore> store_;
  const int64_t max_bytes_;
  std::map<std::string, Entry> entries_;  // by SHA-256
  std::set<std::string> in_use_;
  int64_t size_bytes_ = 0;
  int64_t uses_ = 0;
};

}  // namespace tessera

#endif  // TESSERA_WORKER_AGENT_BLOB_CACHE_H_
