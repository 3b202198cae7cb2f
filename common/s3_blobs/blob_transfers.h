// Signed URLs with which others read and write blobs of an S3 store.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/s3/s3_client.h"
#include "common/s3_blobs/s3_blobs.h"

namespace tessera {

// How to send a blob.
struct BlobUpload {
  bool stored = false;  // the store has the blob: send nothing
  // One request for the whole content, or one for each part.
  std::vector<SignedRequest> requests;
  int64_t part_bytes = 0;  // of each part but the last; 0: the content is sent whole
  std::string id;          // of the upload in parts
};

struct BlobTransferOptions {
  double valid_s = 900;  // of a URL
  // Amazon's limit of one request. Larger contents are sent in parts, at most 1,000.
  int64_t max_put_bytes = 5'000'000'000;
  int64_t min_part_bytes = int64_t{512} << 20;
};

// Thread-safe. Errors of S3Client.
class BlobTransfers {
 public:
  // The objects must outlive this. `hash`: see TryUploads.
  BlobTransfers(S3Client* client, S3Blobs* blobs, std::optional<SignedHash> hash,
                const BlobTransferOptions& options = {})
      : client_(client), blobs_(blobs), hash_(hash), options_(options) {}

  double valid_s() const { return options_.valid_s; }
  // Whether Write returns requests.
  bool takes_uploads() const { return hash_.has_value(); }

  // Does not check that the blob exists.
  StatusOr<SignedRequest> Read(const Digest& digest) const;
  // Renews the blob's time if it exists. Of a content that is sent in parts, `part_sha256` are the hashes of its parts:
  // without them the answer has the size of the parts only. `id`: of an earlier answer, whose URLs have expired.
  // INVALID_ARGUMENT for the wrong number of parts.
  StatusOr<BlobUpload> Write(const Digest& digest, const std::vector<std::string>& part_sha256,
                             const std::string& id) const;
  // Joins the parts. Their hashes were checked, but not that of the whole: readers check it. OK if the blob exists.
  Status Complete(const Digest& digest, const std::string& id, const std::vector<std::string>& etags) const;

 private:
  S3Client* const client_;
  S3Blobs* const blobs_;
  const std::optional<SignedHash> hash_;
  const BlobTransferOptions options_;
};

// Finds out which signed hash the store enforces: sends other bytes, then the right ones, by signed URLs to a key under
// probe/, and removes it. kNone: the store refuses or ignores signed hashes, so a URL can store wrong bytes. Nullopt:
// the store takes no upload by a signed URL. `folder`: for temporary files.
StatusOr<std::optional<SignedHash>> TryUploads(S3Client& client, const std::string& folder);

}  // namespace tessera
