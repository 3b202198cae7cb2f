#include "common/storage/blob_store.h"

#include "common/base/parallel.h"

namespace tessera {

std::vector<Status> BlobStore::StatMany(const std::vector<Digest>& digests) const {
  std::vector<Status> found(digests.size());
  ConcurrentForEach(static_cast<int64_t>(digests.size()), kCallsAtOnce,
                    [&](int64_t i) { found[i] = Stat(digests[i]); });
  return found;
}

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

}  // namespace tessera
