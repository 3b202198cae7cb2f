// Blobs in memory: a store without files, for tests of code that must not depend on them.
#pragma once

#include <chrono>
#include <cstdio>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/storage/blob_store.h"
#include "common/storage/files.h"

namespace tessera {

class MemoryBlobs final : public BlobStore {
 public:
  struct Object {
    std::string content;
    int64_t since_us = 0;
  };

  Status Stat(const Digest& digest) const override {
    TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
    std::lock_guard lock(mutex_);
    return HasLocked(digest) ? absl::OkStatus() : NoBlob(digest);
  }
  StatusOr<std::string> ReadRange(const Digest& digest, int64_t offset_bytes, int64_t size_bytes) const override {
    TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
    std::lock_guard lock(mutex_);
    const auto blob = blobs_.find(digest.sha256);
    if (blob == blobs_.end()) return NoBlob(digest);
    const std::string& content = blob->second.content;
    if (offset_bytes >= static_cast<int64_t>(content.size())) return std::string();
    return content.substr(static_cast<size_t>(offset_bytes), static_cast<size_t>(size_bytes));
  }
  Status Verify(const Digest& digest) const override {
    TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
    std::lock_guard lock(mutex_);
    return VerifyLocked(digest);
  }
  Status VerifyOrQuarantine(const Digest& digest) override {
    TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
    std::lock_guard lock(mutex_);
    const Status status = VerifyLocked(digest);
    if (!absl::IsDataLoss(status)) return status;
    const std::string name = "quarantine " + std::to_string(++last_name_);
    others_[name] = {BlobEntry::Kind::kQuarantined, {blobs_[digest.sha256].content, NowUs()}};
    blobs_.erase(digest.sha256);
    return absl::DataLossError(std::string(status.message()) + " and is now " + name);
  }
  StatusOr<Digest> PutFile(const std::string& path) override {
    TESSERA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path));
    return PutBytes(bytes);
  }
  StatusOr<Digest> MoveFile(const std::string& path) override {
    TESSERA_ASSIGN_OR_RETURN(const Digest digest, PutFile(path));
    std::remove(path.c_str());
    return digest;
  }
  StatusOr<Digest> PutBytes(const std::string& bytes) override {
    const Digest digest{Sha256Hex(bytes), static_cast<int64_t>(bytes.size())};
    std::lock_guard lock(mutex_);
    blobs_[digest.sha256] = {bytes, NowUs()};
    return digest;
  }
  StatusOr<Digest> PutParts(const std::function<void(const Writer& write)>& give) override {
    std::string all;
    give([&](const std::string& bytes) { all += bytes; });
    return PutBytes(all);
  }
  Status Touch(const Digest& digest) override {
    TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
    std::lock_guard lock(mutex_);
    return TouchLocked(digest) ? absl::OkStatus() : NoBlob(digest);
  }
  StatusOr<int64_t> CommittedBytes(const Digest& digest) const override {
    TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
    std::lock_guard lock(mutex_);
    if (TouchLocked(digest)) return digest.size_bytes;
    const auto upload = others_.find(digest.sha256);
    return upload == others_.end() ? 0 : static_cast<int64_t>(upload->second.second.content.size());
  }
  StatusOr<int64_t> Append(const Digest& digest, int64_t offset, const std::string& bytes) override {
    TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
    const int64_t end = offset + static_cast<int64_t>(bytes.size());
    if (offset < 0 || end > digest.size_bytes) return absl::InvalidArgumentError("beyond the blob's size");
    std::lock_guard lock(mutex_);
    if (TouchLocked(digest)) return digest.size_bytes;
    auto& [kind, upload] = others_[digest.sha256];
    kind = BlobEntry::Kind::kLeftover;
    const int64_t committed = static_cast<int64_t>(upload.content.size());
    if (offset > committed) return absl::FailedPreconditionError("a gap");
    if (end <= committed) return committed;
    upload.content += bytes.substr(static_cast<size_t>(committed - offset));
    upload.since_us = NowUs();
    return end;
  }
  Status Complete(const Digest& digest) override {
    TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
    std::lock_guard lock(mutex_);
    if (TouchLocked(digest)) return absl::OkStatus();
    const std::string content = others_[digest.sha256].second.content;
    if (static_cast<int64_t>(content.size()) < digest.size_bytes) return absl::FailedPreconditionError("bytes missing");
    others_.erase(digest.sha256);
    if (Sha256Hex(content) != digest.sha256) return absl::DataLossError("upload dropped");
    blobs_[digest.sha256] = {content, NowUs()};
    return absl::OkStatus();
  }
  StatusOr<std::vector<BlobEntry>> List(int part) const override {
    std::lock_guard lock(mutex_);
    std::vector<BlobEntry> entries;
    for (const auto& [sha256, blob] : blobs_) {
      if (std::stoi(sha256.substr(0, 2), nullptr, 16) != part) continue;
      entries.push_back({BlobEntry::Kind::kBlob, sha256, sha256, Size(blob), blob.since_us});
    }
    if (part != kParts - 1) return entries;
    for (const auto& [name, other] : others_) {
      entries.push_back({other.first, name, "", Size(other.second), other.second.since_us});
    }
    return entries;
  }
  StatusOr<FreeBytes> Remove(const BlobEntry& entry) override {
    std::lock_guard lock(mutex_);
    if (entry.kind != BlobEntry::Kind::kBlob) {
      if (others_.erase(entry.name) == 0) return absl::NotFoundError(entry.name);
      return FreeBytes([] {});
    }
    const auto blob = blobs_.find(entry.sha256);
    const bool same =
        blob != blobs_.end() && (entry.since_us == BlobEntry::kAnyTime || entry.since_us == blob->second.since_us);
    if (!same) return absl::NotFoundError(entry.sha256);
    const std::string name = "removed " + std::to_string(++last_name_);
    others_[name] = {BlobEntry::Kind::kLeftover, std::move(blob->second)};
    blobs_.erase(blob);
    return FreeBytes([this, name] {
      std::lock_guard free_lock(mutex_);
      others_.erase(name);
    });
  }
  std::optional<int64_t> FreeSpace() const override { return std::nullopt; }
  std::string Location() const override { return "memory"; }
  std::optional<std::string> LocalPath(const Digest&) const override { return std::nullopt; }

  // As a fault of the disk would, and as time would.
  void Damage(const Digest& digest, const std::string& content) {
    std::lock_guard lock(mutex_);
    blobs_.at(digest.sha256).content = content;
  }
  void SetTime(const Digest& digest, int64_t since_us) {
    std::lock_guard lock(mutex_);
    blobs_.at(digest.sha256).since_us = since_us;
  }

 private:
  static int64_t NowUs() {
    return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
        .count();
  }
  static int64_t Size(const Object& object) { return static_cast<int64_t>(object.content.size()); }
  static Status NoBlob(const Digest& digest) { return absl::NotFoundError("no blob " + digest.sha256); }
  bool HasLocked(const Digest& digest) const {
    const auto blob = blobs_.find(digest.sha256);
    return blob != blobs_.end() && Size(blob->second) == digest.size_bytes;
  }
  bool TouchLocked(const Digest& digest) const {
    if (!HasLocked(digest)) return false;
    blobs_.at(digest.sha256).since_us = NowUs();
    return true;
  }
  Status VerifyLocked(const Digest& digest) const {
    const auto blob = blobs_.find(digest.sha256);
    if (blob == blobs_.end()) return NoBlob(digest);
    const bool intact = HasLocked(digest) && Sha256Hex(blob->second.content) == digest.sha256;
    return intact ? absl::OkStatus() : absl::DataLossError("blob " + digest.sha256 + " is damaged");
  }

  mutable std::mutex mutex_;
  mutable std::map<std::string, Object> blobs_;                       // by SHA-256
  std::map<std::string, std::pair<BlobEntry::Kind, Object>> others_;  // by name; uploads by SHA-256
  int last_name_ = 0;
};

}  // namespace tessera
