// A blob store in a folder. ROOT/ab/abcd...: blob with this SHA-256; ROOT/partial/: unfinished writes;
// ROOT/quarantine/: quarantined blobs.
#pragma once

#include <array>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/storage/blob_store.h"

namespace tessera {

// A blob's time is the later one of its file's access and modification times. IsFileError accepts errors of the file
// system.
class FolderBlobs final : public BlobStore {
 public:
  // Creates the folder if it is missing.
  static StatusOr<std::unique_ptr<FolderBlobs>> Open(const std::string& root);

  const std::string& root() const { return root_; }
  // Moves the blob out of the store to `path` on the same file system. Replaces an existing file.
  Status MoveTo(const Digest& digest, const std::string& path);

  Status Stat(const Digest& digest) const override;
  StatusOr<std::string> ReadRange(const Digest& digest, int64_t offset_bytes, int64_t size_bytes) const override;
  Status Verify(const Digest& digest) const override;
  Status VerifyOrQuarantine(const Digest& digest) override;
  StatusOr<Digest> PutFile(const std::string& path) override;
  // A rename if the file is on the same file system.
  StatusOr<Digest> MoveFile(const std::string& path) override;
  StatusOr<Digest> PutBytes(const std::string& bytes) override;
  StatusOr<Digest> PutParts(const std::function<void(const Writer& write)>& give) override;
  Status Touch(const Digest& digest) override;
  StatusOr<int64_t> CommittedBytes(const Digest& digest) const override;
  StatusOr<int64_t> Append(const Digest& digest, int64_t offset, const std::string& bytes) override;
  Status Complete(const Digest& digest) override;
  StatusOr<std::vector<BlobEntry>> List(int part) const override;
  StatusOr<FreeBytes> Remove(const BlobEntry& entry) override;
  std::optional<int64_t> FreeSpace() const override;
  std::string Location() const override { return root_; }
  std::optional<std::string> LocalPath(const Digest& digest) const override { return Path(digest); }

 private:
  explicit FolderBlobs(std::string root) : root_(std::move(root)) {}
  // The digest must pass CheckDigest.
  std::string Path(const Digest& digest) const;
  std::string PartialPath(const Digest& digest) const;
  std::string NewTemporary() const;  // a unique path
  // Sets the access time of the blob's file. False if the file does not exist.
  bool TouchFile(const Digest& digest) const;
  // Renames `temporary` to the blob's path. On error `temporary` stays.
  Status Publish(const std::string& temporary, const Digest& digest);
  std::mutex& UploadMutex(const Digest& digest) const { return upload_mutexes_[digest.sha256[0] & 15]; }

  const std::string root_;
  mutable std::array<std::mutex, 16> upload_mutexes_;  // by the digest's first digit
};

}  // namespace tessera
