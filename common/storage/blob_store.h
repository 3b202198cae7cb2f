// A folder of files named by their content: ROOT/ab/abcd...: the blob of that SHA-256; ROOT/partial/: unfinished
// uploads; ROOT/set_aside/: files that were no longer what their names said.
#ifndef TESSERA_COMMON_STORAGE_BLOB_STORE_H_
#define TESSERA_COMMON_STORAGE_BLOB_STORE_H_

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "common/base/status.h"
#include "common/storage/hash.h"

namespace tessera {

// Blobs appear whole or not at all and are never changed. Thread-safe; several processes may share the folder.
class BlobStore {
 public:
  // Makes the folder if it is missing.
  static StatusOr<std::unique_ptr<BlobStore>> Open(const std::string& root);

  const std::string& root() const { return root_; }

  // Where the blob lies, or would. `digest` must be checked (CheckDigest).
  std::string Path(const Digest& digest) const;

  // Whether the blob is there with its size. Does not read it: Verify does.
  bool Has(const Digest& digest) const;

  // Reads the blob and compares: NOT_FOUND, or DATA_LOSS if its content is no longer what it was.
  Status Verify(const Digest& digest) const;

  // Verify; what is not what its name says is moved to ROOT/set_aside, so that the content can be stored again, and the
  // DATA_LOSS tells where it is now. UNAVAILABLE if the blob cannot be opened or moved now.
  Status VerifyOrSetAside(const Digest& digest);

  // Bytes that may still be stored, as the file system tells; none if it does not.
  std::optional<int64_t> FreeBytes() const;

  // The whole content of a small blob, verified.
  StatusOr<std::string> Read(const Digest& digest, int64_t max_bytes = int64_t{1} << 30) const;

  // What is stored again is not written, but its file's time of access is now: what looks old has nobody who has just
  // found it there.

  // Stores a copy of a file (hashed as it is copied), durable on return.
  StatusOr<Digest> PutFile(const std::string& path);
  // The same, but takes the file away: renamed where it lies on the same file system.
  StatusOr<Digest> MoveFile(const std::string& path);
  // What is stored already is read, and replaced if it is damaged.
  StatusOr<Digest> PutBytes(const std::string& bytes);
  // Stores all that `give` writes.
  using Writer = std::function<void(const std::string& bytes)>;
  StatusOr<Digest> PutParts(const std::function<void(const Writer& write)>& give);

  // Bytes of the blob that are here: of an unfinished upload, or all, and then it is as if it had been stored again.
  StatusOr<int64_t> CommittedBytes(const Digest& digest) const;
  // Adds bytes [offset, offset + size) to the unfinished upload; bytes it has already are skipped. Gives the committed
  // size after it. FAILED_PRECONDITION if `offset` leaves a gap, INVALID_ARGUMENT beyond the digest's size.
  StatusOr<int64_t> Append(const Digest& digest, int64_t offset, const std::string& bytes);
  // Makes the blob of a full upload. DATA_LOSS, and the upload is dropped, if it does not hash to its digest.
  // FAILED_PRECONDITION if bytes are missing. OK if the blob is there already.
  Status Complete(const Digest& digest);

 private:
  explicit BlobStore(std::string root) : root_(std::move(root)) {}
  std::string PartialPath(const Digest& digest) const;
  std::string NewTemporary() const;  // a path that nobody else has
  // Sets the time of access of the blob's file. False if it is not there.
  bool Touch(const Digest& digest) const;
  // On error `temporary` stays.
  Status Publish(const std::string& temporary, const Digest& digest);
  std::mutex& UploadMutex(const Digest& digest) const { return upload_mutexes_[digest.sha256[0] & 15]; }

  const std::string root_;
  mutable std::array<std::mutex, 16> upload_mutexes_;  // by the digest's first digit
};

}  // namespace tessera

#endif  // TESSERA_COMMON_STORAGE_BLOB_STORE_H_
