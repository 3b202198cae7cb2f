// The worker's local cache of blobs, with least-recently-used eviction.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "common/base/status.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"

namespace tessera {

// A folder with at most `max_bytes` of blobs; the inputs of a running task may exceed the limit until it ends. The
// content survives restarts. A blob of an earlier process, or with a changed file, is verified before its next use. Not
// thread-safe; one process per folder.
class BlobCache {
 public:
  static StatusOr<std::unique_ptr<BlobCache>> Open(const std::string& root, int64_t max_bytes);

  // Stores the blob `digest` in `store`.
  using Fetcher = std::function<Status(const Digest& digest, BlobStore& store)>;

  // Path of the blob. Fetches it if it is missing or damaged. The blob is in use, and not evicted, until Release.
  StatusOr<std::string> Get(const Digest& digest, const Fetcher& fetch);

  // Moves a file into the cache. The caller has verified that it hashes to `digest`.
  Status Adopt(const std::string& path, const Digest& digest);

  // Marks all blobs as unused and evicts down to the limit.
  void Release();

  int64_t size_bytes() const { return size_bytes_; }
  bool Holds(const Digest& digest) const { return entries_.contains(digest.sha256); }

 private:
  struct Entry {
    int64_t size_bytes = 0;
    int64_t last_use = 0;  // order of use
    FileStamp stamp = {};  // at its last verification or write by this process; default: none
  };

  BlobCache(std::unique_ptr<FolderBlobs> store, int64_t max_bytes) : store_(std::move(store)), max_bytes_(max_bytes) {}
  std::string PathOf(const Digest& digest) const;
  void Insert(const Digest& digest);
  void Remove(const std::string& sha256);
  // Removes least recently used blobs that are not in use, until `incoming_bytes` more fit.
  void MakeRoom(int64_t incoming_bytes);

  std::unique_ptr<FolderBlobs> store_;
  const int64_t max_bytes_;
  std::map<std::string, Entry> entries_;  // by SHA-256
  std::set<std::string> in_use_;
  int64_t size_bytes_ = 0;
  int64_t uses_ = 0;
};

}  // namespace tessera
