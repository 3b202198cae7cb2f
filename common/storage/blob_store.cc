#include "common/storage/blob_store.h"

#include <utility>

#include "common/base/parallel.h"

namespace tessera {

StatusOr<std::string> BlobStore::Read(const Digest& digest, int64_t max_bytes) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  if (digest.size_bytes > max_bytes) {
    return absl::ResourceExhaustedError("blob " + digest.sha256 + " has " + std::to_string(digest.size_bytes) +
                                        " bytes, expected at most " + std::to_string(max_bytes));
  }
  TESSERA_ASSIGN_OR_RETURN(std::string content, ReadRange(digest, 0, digest.size_bytes));
  if (Sha256Hex(content) != digest.sha256) return absl::DataLossError("blob " + digest.sha256 + " is damaged");
  return content;
}

StatusOr<BlobStore::Removed> BlobStore::RemoveAll(const std::vector<BlobEntry>& entries,
                                                  const std::function<bool()>& may_remove) {
  Removed removed;
  std::vector<FreeBytes> each;
  for (const BlobEntry& entry : entries) {
    if (may_remove && !may_remove()) return absl::CancelledError("blobs may not be removed now");
    StatusOr<FreeBytes> free_bytes = Remove(entry);
    if (absl::IsNotFound(free_bytes.status())) continue;
    TESSERA_RETURN_IF_ERROR(free_bytes.status());
    removed.entries.push_back(entry);
    each.push_back(*std::move(free_bytes));
  }
  removed.free_bytes = [each = std::move(each)] {
    for (const FreeBytes& free_bytes : each) free_bytes();
  };
  return removed;
}

std::vector<Status> StatMany(const BlobStore& blobs, const std::vector<Digest>& digests) {
  std::vector<Status> found(digests.size());
  ConcurrentForEach(static_cast<int64_t>(digests.size()), BlobStore::kCallsAtOnce,
                    [&](int64_t i) { found[i] = blobs.Stat(digests[i]); });
  return found;
}

}  // namespace tessera
