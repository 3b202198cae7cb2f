#include "worker/agent/blob_cache.h"

#include <algorithm>
#include <filesystem>
#include <vector>

#include "common/storage/files.h"

namespace tessera {

StatusOr<std::unique_ptr<BlobCache>> BlobCache::Open(const std::string& root, int64_t max_bytes) {
  TESSERA_ASSIGN_OR_RETURN(auto store, BlobStore::Open(root));
  auto cache = std::unique_ptr<BlobCache>(new BlobCache(std::move(store), max_bytes));
  struct Found {
    FileStamp stamp;
    Digest digest;
  };
  std::vector<Found> found;
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> files, ListFiles(root));
  for (const std::string& file : files) {
    const auto stamp = StampOf(root + "/" + file);
    if (!stamp.ok()) continue;
    const Digest digest{std::filesystem::path(file).filename().string(), stamp->size_bytes};
    if (CheckDigest(digest).ok() && cache->store_->Path(digest) == root + "/" + file) found.push_back({*stamp, digest});
  }
  std::sort(found.begin(), found.end(),
            [](const Found& a, const Found& b) { return a.stamp.modified_ns < b.stamp.modified_ns; });
  for (const Found& one : found) {
    cache->Insert(one.digest);
    cache->entries_[one.digest.sha256].stamp = {};
  }
  cache->MakeRoom(0);
  return cache;
}

StatusOr<std::string> BlobCache::Get(const Digest& digest, const Fetcher& fetch) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  const auto entry = entries_.find(digest.sha256);
  if (entry != entries_.end()) {
    const auto stamp = StampOf(store_->Path(digest));
    const bool known = stamp.ok() && *stamp == entry->second.stamp;
    if (!known && !store_->Verify(digest).ok()) Remove(digest.sha256);
  }
  const bool in_use = !in_use_.insert(digest.sha256).second;
  if (!entries_.contains(digest.sha256)) {
    MakeRoom(digest.size_bytes);
    TESSERA_RETURN_IF_ERROR(fetch(digest, *store_));
    Insert(digest);
  }
  entries_[digest.sha256].last_use = ++uses_;
  const std::string path = store_->Path(digest);
  std::error_code ignored;  // the time only orders what a later process finds
  if (!in_use) std::filesystem::last_write_time(path, std::filesystem::file_time_type::clock::now(), ignored);
  entries_[digest.sha256].stamp = StampOf(path).value_or(FileStamp());
  return path;
}

Status BlobCache::Adopt(const std::string& path, const Digest& digest) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  if (entries_.contains(digest.sha256)) return RemoveTree(path);
  MakeRoom(digest.size_bytes);
  TESSERA_ASSIGN_OR_RETURN(const Digest found, store_->MoveFile(path));
  Insert(found);
  return absl::OkStatus();
}

void BlobCache::Release() {
  in_use_.clear();
  MakeRoom(0);
}

void BlobCache::Insert(const Digest& digest) {
  entries_[digest.sha256] = {digest.size_bytes, ++uses_, StampOf(store_->Path(digest)).value_or(FileStamp())};
  size_bytes_ += digest.size_bytes;
}

void BlobCache::Remove(const std::string& sha256) {
  const auto entry = entries_.find(sha256);
  if (entry == entries_.end()) return;
  std::error_code ignored;  // what cannot be removed is found again by the next process
  std::filesystem::remove(store_->Path({sha256, entry->second.size_bytes}), ignored);
  size_bytes_ -= entry->second.size_bytes;
  entries_.erase(entry);
}

void BlobCache::MakeRoom(int64_t incoming_bytes) {
  while (size_bytes_ + incoming_bytes > max_bytes_) {
    auto oldest = entries_.end();
    for (auto entry = entries_.begin(); entry != entries_.end(); ++entry) {
      if (in_use_.contains(entry->first)) continue;
      if (oldest == entries_.end() || entry->second.last_use < oldest->second.last_use) oldest = entry;
    }
    if (oldest == entries_.end()) return;
    Remove(std::string(oldest->first));
  }
}

}  // namespace tessera
