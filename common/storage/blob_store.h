// The interface of blob stores: contents that are named by their SHA-256.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/storage/hash.h"

namespace tessera {

// One object of a store, as List gives it.
struct BlobEntry {
  enum class Kind {
    kBlob,
    kLeftover,     // of a write that did not finish, or of Remove
    kQuarantined,  // a damaged blob: BlobStore::VerifyOrQuarantine
  };
  static constexpr int64_t kAnyTime = -1;

  Kind kind = Kind::kBlob;
  std::string name;    // unique in the store; its form is the store's own
  std::string sha256;  // of kBlob
  int64_t size_bytes = 0;
  int64_t since_us = 0;  // Unix time: last stored, touched or read; of kQuarantined: when it was quarantined
};

// A blob appears whole or not at all and never changes. A name that is no blob yet may have an unfinished upload.
//
// Threads: all calls are thread-safe. Several processes may use one store.
// Durability: a blob is durable when the call that stored it returns OK. An unfinished upload may be lost in a crash.
// Errors: INVALID_ARGUMENT for a digest that CheckDigest refuses. NOT_FOUND if there is no such blob. DATA_LOSS if its
// content does not have its name's hash. RESOURCE_EXHAUSTED if the store is full. UNAVAILABLE, or an error that
// IsFileError accepts, for a store that does not answer now: the blob may exist, and the call may be repeated.
// Memory: streams take at most 1 MiB, whatever the size of the blob; Read and ReadRange return what they read.
class BlobStore {
 public:
  virtual ~BlobStore() = default;

  // --- Read ---

  // OK if the blob exists with the digest's size. Does not read the content.
  virtual Status Stat(const Digest& digest) const = 0;
  bool Has(const Digest& digest) const { return Stat(digest).ok(); }
  // Up to `size_bytes` bytes from `offset_bytes`; fewer only at the end of what is stored. Does not verify them.
  virtual StatusOr<std::string> ReadRange(const Digest& digest, int64_t offset_bytes, int64_t size_bytes) const = 0;
  // The whole content, verified. RESOURCE_EXHAUSTED if it is larger than `max_bytes`.
  StatusOr<std::string> Read(const Digest& digest, int64_t max_bytes = int64_t{1} << 30) const;
  // Reads the content and compares its hash with the name.
  virtual Status Verify(const Digest& digest) const = 0;
  // Verify. A damaged blob is quarantined: it is no blob any more, so that its content can be stored again, and List
  // gives it as kQuarantined. The DATA_LOSS names where it is now. UNAVAILABLE if it cannot be read or moved now.
  virtual Status VerifyOrQuarantine(const Digest& digest) = 0;

  // --- Store. A content that is stored already is kept and touched; if it is damaged, it is replaced. ---

  // Stores a copy of a local file.
  virtual StatusOr<Digest> PutFile(const std::string& path) = 0;
  // Stores a local file and removes it. On error the file stays.
  virtual StatusOr<Digest> MoveFile(const std::string& path) = 0;
  virtual StatusOr<Digest> PutBytes(const std::string& bytes) = 0;
  // Stores all bytes that `give` passes to `write`, in this order.
  using Writer = std::function<void(const std::string& bytes)>;
  virtual StatusOr<Digest> PutParts(const std::function<void(const Writer& write)>& give) = 0;
  // Sets the blob's time (BlobEntry::since_us) to now.
  virtual Status Touch(const Digest& digest) = 0;

  // --- Upload in parts, which outlives the process ---

  // Bytes of the unfinished upload; 0 if there is none; all if the blob exists, which is touched then.
  virtual StatusOr<int64_t> CommittedBytes(const Digest& digest) const = 0;
  // Appends bytes [offset, offset + size) to the upload; bytes that it has are skipped. Gives the committed size.
  // FAILED_PRECONDITION if `offset` leaves a gap, INVALID_ARGUMENT beyond the digest's size.
  virtual StatusOr<int64_t> Append(const Digest& digest, int64_t offset, const std::string& bytes) = 0;
  // Makes the blob of a full upload. OK if the blob exists. FAILED_PRECONDITION if bytes are missing. DATA_LOSS if the
  // bytes do not hash to the digest: the upload is dropped.
  virtual Status Complete(const Digest& digest) = 0;

  // --- List and remove ---

  // List gives the store in this many parts, each small enough to hold in memory.
  static constexpr int kParts = 258;
  // All objects of part `part`, of which some may be removed already. Objects of no kind are not listed.
  virtual std::vector<BlobEntry> List(int part) const = 0;
  // Removes a listed object: it is not found any more when this returns. Gives a function that frees its bytes, which
  // may take long; if that is never called, List gives a kLeftover. NOT_FOUND if the object is gone, or if it is a blob
  // whose time is not `entry.since_us` any more (kAnyTime: removed whatever its time).
  using FreeBytes = std::function<void()>;
  virtual StatusOr<FreeBytes> Remove(const BlobEntry& entry) = 0;

  // --- The store itself ---

  // Bytes that may still be stored; none if the store has no limit or cannot tell.
  virtual std::optional<int64_t> FreeSpace() const = 0;
  // Where the store is, for messages only.
  virtual std::string Location() const = 0;
  // A file with the content of the blob, whether it exists or not; for processes that share the store's file system.
  // It may be read and linked, never written. None if the store keeps no such files.
  virtual std::optional<std::string> LocalPath(const Digest& digest) const = 0;
};

}  // namespace tessera
