#include "worker/agent/blob_cache.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "common/storage/files.h"

namespace tessera {

// Waits until no other call works on the blob, and keeps others waiting until destroyed. The lock must be held then.
class BlobCache::Turn {
 public:
  Turn(BlobCache& cache, const std::string& sha256, std::unique_lock<std::mutex>& lock)
      : cache_(cache), sha256_(sha256) {
    cache_.changed_.wait(lock, [&] { return cache_.busy_.insert(sha256_).second; });
  }
  ~Turn() {
    cache_.busy_.erase(sha256_);
    cache_.changed_.notify_all();
  }
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;

 private:
  BlobCache& cache_;
  const std::string sha256_;
};

StatusOr<std::unique_ptr<BlobCache>> BlobCache::Open(const std::string& root, int64_t max_bytes) {
  TESSERA_ASSIGN_OR_RETURN(auto store, FolderBlobs::Open(root));
  auto cache = std::unique_ptr<BlobCache>(new BlobCache(std::move(store), max_bytes));
  std::vector<BlobEntry> found;
  for (int part = 0; part < BlobStore::kParts; ++part) {
    TESSERA_ASSIGN_OR_RETURN(std::vector<BlobEntry> entries, cache->store_->List(part));
    for (BlobEntry& entry : entries) {
      if (entry.kind == BlobEntry::Kind::kBlob) found.push_back(std::move(entry));
    }
  }
  std::sort(found.begin(), found.end(), [](const BlobEntry& a, const BlobEntry& b) { return a.since_us < b.since_us; });
  for (const BlobEntry& entry : found) {
    cache->InsertLocked({entry.sha256, entry.size_bytes});
    cache->entries_[entry.sha256].stamp = {};
  }
  cache->MakeRoomLocked(0);
  return cache;
}

int64_t BlobCache::size_bytes() const {
  std::lock_guard lock(mutex_);
  return size_bytes_;
}

bool BlobCache::Holds(const Digest& digest) const {
  std::lock_guard lock(mutex_);
  return entries_.contains(digest.sha256);
}

StatusOr<std::string> BlobCache::Get(const Digest& digest, const Fetcher& fetch) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  std::unique_lock lock(mutex_);
  const bool in_use = !in_use_.insert(digest.sha256).second;
  const Turn turn(*this, digest.sha256, lock);
  const auto entry = entries_.find(digest.sha256);
  if (entry != entries_.end()) {
    const auto stamp = StampOf(PathOf(digest));
    if (!stamp.ok() || !(*stamp == entry->second.stamp)) {
      lock.unlock();
      const bool intact = store_->Verify(digest).ok();
      lock.lock();
      if (!intact) RemoveLocked(digest.sha256);
    }
  }
  if (!entries_.contains(digest.sha256)) {
    MakeRoomLocked(digest.size_bytes);
    incoming_bytes_ += digest.size_bytes;
    lock.unlock();
    const Status fetched = fetch(digest, *store_);
    lock.lock();
    incoming_bytes_ -= digest.size_bytes;
    TESSERA_RETURN_IF_ERROR(fetched);
    InsertLocked(digest);
  }
  entries_[digest.sha256].last_use = ++uses_;
  if (!in_use) store_->Touch(digest).IgnoreError();  // the time gives the next process the order of use
  entries_[digest.sha256].stamp = StampOf(PathOf(digest)).value_or(FileStamp());
  return PathOf(digest);
}

Status BlobCache::Adopt(const std::string& path, const Digest& digest) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  std::unique_lock lock(mutex_);
  const Turn turn(*this, digest.sha256, lock);
  if (entries_.contains(digest.sha256)) return RemoveTree(path);
  MakeRoomLocked(digest.size_bytes);
  incoming_bytes_ += digest.size_bytes;
  lock.unlock();
  const StatusOr<Digest> found = store_->MoveFile(path);
  lock.lock();
  incoming_bytes_ -= digest.size_bytes;
  TESSERA_RETURN_IF_ERROR(found.status());
  InsertLocked(*found);
  return absl::OkStatus();
}

void BlobCache::Release() {
  std::lock_guard lock(mutex_);
  in_use_.clear();
  MakeRoomLocked(0);
}

// Tasks read the files directly.
std::string BlobCache::PathOf(const Digest& digest) const { return *store_->LocalPath(digest); }

void BlobCache::InsertLocked(const Digest& digest) {
  entries_[digest.sha256] = {digest.size_bytes, ++uses_, StampOf(PathOf(digest)).value_or(FileStamp())};
  size_bytes_ += digest.size_bytes;
}

void BlobCache::RemoveLocked(const std::string& sha256) {
  const auto entry = entries_.find(sha256);
  if (entry == entries_.end()) return;
  // The next process finds a blob that could not be removed.
  const auto removed =
      store_->Remove({BlobEntry::Kind::kBlob, "", sha256, entry->second.size_bytes, BlobEntry::kAnyTime});
  if (removed.ok()) (*removed)();
  size_bytes_ -= entry->second.size_bytes;
  entries_.erase(entry);
}

void BlobCache::MakeRoomLocked(int64_t incoming_bytes) {
  while (size_bytes_ + incoming_bytes_ + incoming_bytes > max_bytes_) {
    auto oldest = entries_.end();
    for (auto entry = entries_.begin(); entry != entries_.end(); ++entry) {
      if (in_use_.contains(entry->first) || busy_.contains(entry->first)) continue;
      if (oldest == entries_.end() || entry->second.last_use < oldest->second.last_use) oldest = entry;
    }
    if (oldest == entries_.end()) return;
    RemoveLocked(std::string(oldest->first));
  }
}

}  // namespace tessera
