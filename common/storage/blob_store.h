// Interface of a content-addressed store: each blob is named by the SHA-256 of its content.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/storage/hash.h"

namespace tessera {

// An object that List returns.
struct BlobEntry {
  enum class Kind {
    kBlob,
    kLeftover,     // an unfinished write, or a removed blob whose bytes are not freed yet
    kQuarantined,  // a damaged blob (BlobStore::VerifyOrQuarantine)
  };
  static constexpr int64_t kAnyTime = -1;

  Kind kind = Kind::kBlob;
  std::string name;    // unique in the store; format depends on the store
  std::string sha256;  // for kBlob
  int64_t size_bytes = 0;
  int64_t since_us = 0;  // Unix time of the last store, touch or read; kQuarantined: of the quarantine
};

// A blob appears atomically and never changes. Before that, its name may have an unfinished upload.
//
// Threads: all calls are thread-safe. Several processes may use one store.
// Durability: a blob is durable when the call that stored it returns OK. An unfinished upload may be lost in a crash.
// Errors: INVALID_ARGUMENT for a digest that CheckDigest refuses. NOT_FOUND if there is no such blob. DATA_LOSS if its
// content does not hash to its name. RESOURCE_EXHAUSTED if the store is full. UNAVAILABLE, or an error that
// IsFileError accepts, for a transient error: the blob may exist, and the caller may retry.
// Memory: streaming calls buffer at most 1 MiB.
class BlobStore {
 public:
  // Calls that a caller with many blobs makes at once: a store behind a network answers each after some milliseconds.
  static constexpr int kCallsAtOnce = 16;

  virtual ~BlobStore() = default;

  // --- Read ---

  // Checks that the blob exists and has the digest's size. Does not read the content.
  virtual Status Stat(const Digest& digest) const = 0;
  bool Has(const Digest& digest) const { return Stat(digest).ok(); }
  // Up to `size_bytes` bytes from `offset_bytes`; fewer only at the end of the blob. Not verified.
  virtual StatusOr<std::string> ReadRange(const Digest& digest, int64_t offset_bytes, int64_t size_bytes) const = 0;
  // The whole content, verified. RESOURCE_EXHAUSTED if it is larger than `max_bytes`.
  StatusOr<std::string> Read(const Digest& digest, int64_t max_bytes = int64_t{1} << 30) const;
  // Reads the content and compares its hash with the name.
  virtual Status Verify(const Digest& digest) const = 0;
  // Verifies the blob and quarantines it if it is damaged: its content can then be stored again, and List returns the
  // object as kQuarantined. DATA_LOSS names its new location. UNAVAILABLE if it cannot be read or moved now.
  virtual Status VerifyOrQuarantine(const Digest& digest) = 0;

  // --- Store. An existing blob is touched; if it is damaged, it is replaced. ---

  // Stores a copy of a local file.
  virtual StatusOr<Digest> PutFile(const std::string& path) = 0;
  // Stores a local file and removes it. On error the file stays.
  virtual StatusOr<Digest> MoveFile(const std::string& path) = 0;
  virtual StatusOr<Digest> PutBytes(const std::string& bytes) = 0;
  // Stores the concatenation of all bytes that `give` passes to `write`.
  using Writer = std::function<void(const std::string& bytes)>;
  virtual StatusOr<Digest> PutParts(const std::function<void(const Writer& write)>& give) = 0;
  // Sets the blob's time (BlobEntry::since_us) to now.
  virtual Status Touch(const Digest& digest) = 0;

  // --- Resumable upload. It survives a restart of the process. ---

  // Size of the unfinished upload; 0 if there is none. If the blob exists, touches it and returns its size.
  virtual StatusOr<int64_t> CommittedBytes(const Digest& digest) const = 0;
  // Appends bytes [offset, offset + size) to the upload, except those it already has. Returns the committed size.
  // FAILED_PRECONDITION if `offset` leaves a gap, INVALID_ARGUMENT beyond the digest's size.
  virtual StatusOr<int64_t> Append(const Digest& digest, int64_t offset, const std::string& bytes) = 0;
  // Turns a complete upload into a blob. OK if the blob exists. FAILED_PRECONDITION if bytes are missing. DATA_LOSS if
  // the bytes do not hash to the digest; the upload is then dropped.
  virtual Status Complete(const Digest& digest) = 0;

  // --- List and remove ---

  // Number of parts in which List returns the store. Each part fits in memory.
  static constexpr int kParts = 258;
  // All objects of a part. Some may have been removed since. Unknown files are not listed. Errors of a remote store.
  virtual StatusOr<std::vector<BlobEntry>> List(int part) const = 0;
  // Removes a listed object. Returns a function that frees its bytes, which may take long; until then, List may return
  // a kLeftover. NOT_FOUND if the object does not exist, or if it is a blob whose time has changed from
  // `entry.since_us` (kAnyTime: not compared).
  using FreeBytes = std::function<void()>;
  virtual StatusOr<FreeBytes> Remove(const BlobEntry& entry) = 0;

  // --- Properties ---

  // Free bytes; nullopt if the store has no limit or it is unknown.
  virtual std::optional<int64_t> FreeSpace() const = 0;
  // Location of the store, for messages only.
  virtual std::string Location() const = 0;
  // Path of the blob's file for processes that share the store's file system, whether or not the blob exists. They may
  // read and link the file but must not write to it. Nullopt if the store has no such files.
  virtual std::optional<std::string> LocalPath(const Digest& digest) const = 0;

  // --- Remove several ---

  struct Removed {
    std::vector<BlobEntry> entries;
    FreeBytes free_bytes;  // of all of them
  };
  // Removes several listed objects at once, which takes less time in a remote store. Skips objects for which Remove
  // would return NOT_FOUND. `may_remove` (may be empty) is asked right before each removal; CANCELLED if it returns
  // false. A remote store that does not remove within about 3 s returns an error, and removes nothing later.
  virtual StatusOr<Removed> RemoveAll(const std::vector<BlobEntry>& entries, const std::function<bool()>& may_remove);
};

// Stat of each digest, in their order, with several calls at once.
std::vector<Status> StatMany(const BlobStore& blobs, const std::vector<Digest>& digests);

}  // namespace tessera
