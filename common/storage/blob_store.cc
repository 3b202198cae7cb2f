#include "common/storage/blob_store.h"

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

}  // namespace tessera
