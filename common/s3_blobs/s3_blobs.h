// A blob store in an S3 bucket. blobs/ab/abcd...: blob with this SHA-256; quarantine/: quarantined blobs.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <shared_mutex>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/s3/s3_client.h"
#include "common/storage/blob_store.h"
#include "common/storage/folder_blobs.h"

namespace tessera {

// A blob's time is the modification time of its object, by the clock of the S3 store: S3 does not record reads. Storing
// a blob writes it again. Touch and the calls that find a blob stored renew its time (a copy of the object onto itself)
// only if the blob is older than half the grace period: a blob with a young time is not removed anyway.
//
// Uploads in progress, and files of PutParts, are staged in a local folder. Leftovers are those, and unfinished
// multipart uploads. Removed bytes are freed at once.
class S3Blobs final : public BlobStore {
 public:
  // The key of the blob's object. The digest must pass CheckDigest.
  static std::string KeyOf(const Digest& digest);

  // `staging`: a folder, created if it is missing, of this process only. `grace_s`: age below which no blob is removed.
  // `client` and `clock` must outlive the store.
  static StatusOr<std::unique_ptr<S3Blobs>> Open(S3Client* client, const Clock* clock, const std::string& staging,
                                                 double grace_s);
  // Blobs are removed by this client, of the same location: its requests should not be repeated. Default: `client`.
  void RemoveBy(S3Client* client) { remover_ = client; }
  // Options of such a client: one attempt of at most about 3 s.
  static S3ClientOptions RemovalOptions(S3ClientOptions options);

  Status Stat(const Digest& digest) const override;
  StatusOr<std::string> ReadRange(const Digest& digest, int64_t offset_bytes, int64_t size_bytes) const override;
  Status Verify(const Digest& digest) const override;
  Status VerifyOrQuarantine(const Digest& digest) override;
  StatusOr<Digest> PutFile(const std::string& path) override;
  StatusOr<Digest> MoveFile(const std::string& path) override;
  StatusOr<Digest> PutBytes(const std::string& bytes) override;
  StatusOr<Digest> PutParts(const std::function<void(const Writer& write)>& give) override;
  Status Touch(const Digest& digest) override;
  StatusOr<int64_t> CommittedBytes(const Digest& digest) const override;
  StatusOr<int64_t> Append(const Digest& digest, int64_t offset, const std::string& bytes) override;
  Status Complete(const Digest& digest) override;
  StatusOr<std::vector<BlobEntry>> List(int part) const override;
  StatusOr<FreeBytes> Remove(const BlobEntry& entry) override;
  StatusOr<Removed> RemoveAll(const std::vector<BlobEntry>& entries, const std::function<bool()>& may_remove) override;
  std::optional<int64_t> FreeSpace() const override { return std::nullopt; }
  std::string Location() const override { return ToText(client_->location()); }
  std::optional<std::string> LocalPath(const Digest&) const override { return std::nullopt; }

 private:
  S3Blobs(S3Client* client, const Clock* clock, std::unique_ptr<FolderBlobs> staging, double grace_s)
      : client_(client), remover_(client), clock_(clock), staging_(std::move(staging)), grace_s_(grace_s) {}
  // Renews the blob if it is old. NOT_FOUND if it does not exist with the digest's size.
  Status Renew(const Digest& digest) const;
  // The listed objects of `entries` (all of one kind) that still exist with their listed time.
  StatusOr<std::vector<BlobEntry>> Unchanged(const std::vector<BlobEntry>& entries) const;
  std::mutex& UploadMutex(const Digest& digest) const { return upload_mutexes_[digest.sha256[0] & 15]; }

  S3Client* const client_;
  S3Client* remover_;
  const Clock* const clock_;
  const std::unique_ptr<FolderBlobs> staging_;
  const double grace_s_;
  mutable std::array<std::mutex, 16> upload_mutexes_;  // by the digest's first digit
  // Held shared while a blob is renewed, and exclusively from the check of a blob's time to its removal.
  mutable std::shared_mutex renewal_mutex_;
};

}  // namespace tessera
