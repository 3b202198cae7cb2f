#include "common/s3_blobs/blob_transfers.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/storage/files.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

constexpr int64_t kMaxParts = 1000;  // so that all their URLs fit in a message; Amazon's limit is 10,000
constexpr double kProbe_s = 60;

int64_t PartBytes(const Digest& digest, const BlobTransferOptions& options) {
  return std::max(options.min_part_bytes, (digest.size_bytes + kMaxParts - 1) / kMaxParts);
}

// An outage is no refusal.
bool IsOutage(const Status& status) { return absl::IsUnavailable(status) || absl::IsCancelled(status); }

}  // namespace

StatusOr<SignedRequest> BlobTransfers::Read(const Digest& digest) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  return client_->SignGet(S3Blobs::KeyOf(digest), options_.valid_s);
}

StatusOr<BlobUpload> BlobTransfers::Write(const Digest& digest, const std::vector<std::string>& part_sha256,
                                          const std::string& id) const {
  BlobUpload upload;
  const Status found = blobs_->Touch(digest);
  upload.stored = found.ok();
  if (upload.stored) return upload;
  if (!absl::IsNotFound(found)) return found;
  if (!hash_) return absl::FailedPreconditionError("the object store takes no uploads by signed URLs");
  const std::string key = S3Blobs::KeyOf(digest);
  if (digest.size_bytes <= options_.max_put_bytes) {
    TESSERA_ASSIGN_OR_RETURN(SignedRequest request,
                             client_->SignPut(key, digest.sha256, digest.size_bytes, options_.valid_s, *hash_));
    upload.requests.push_back(std::move(request));
    return upload;
  }
  upload.part_bytes = PartBytes(digest, options_);
  if (part_sha256.empty()) return upload;
  const int64_t parts = (digest.size_bytes + upload.part_bytes - 1) / upload.part_bytes;
  if (static_cast<int64_t>(part_sha256.size()) != parts) {
    return InputError("part_sha256", "", absl::StrCat(part_sha256.size(), " hashes"), absl::StrCat(parts));
  }
  for (const std::string& sha256 : part_sha256) TESSERA_RETURN_IF_ERROR(CheckDigest({sha256, 0}));
  upload.id = id;
  if (id.empty()) {
    TESSERA_ASSIGN_OR_RETURN(upload.id, client_->StartUpload(key));
  }
  for (int64_t part = 0; part < parts; ++part) {
    const int64_t size_bytes = std::min(upload.part_bytes, digest.size_bytes - part * upload.part_bytes);
    TESSERA_ASSIGN_OR_RETURN(SignedRequest request,
                             client_->SignPart(key, upload.id, static_cast<int>(part) + 1, part_sha256[part],
                                               size_bytes, options_.valid_s, *hash_));
    upload.requests.push_back(std::move(request));
  }
  return upload;
}

Status BlobTransfers::Complete(const Digest& digest, const std::string& id,
                               const std::vector<std::string>& etags) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  const Status completed = client_->CompleteUpload(S3Blobs::KeyOf(digest), id, etags);
  // An answer that was lost is asked for again: the upload is gone then.
  if (absl::IsNotFound(completed) && blobs_->Has(digest)) return absl::OkStatus();
  return completed;
}

StatusOr<std::optional<SignedHash>> TryUploads(S3Client& client, const std::string& folder) {
  TESSERA_ASSIGN_OR_RETURN(const TempFolder scratch, TempFolder::Create(folder));
  const std::string key = absl::StrCat("probe/", UniqueName()), content = "right bytes", other = "wrong bytes";
  const std::string right_file = scratch.path() + "/right", wrong_file = scratch.path() + "/wrong";
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(right_file, content));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(wrong_file, other));
  SignedTransfers transfers;
  const auto send = [&](SignedHash hash, const std::string& file) -> Status {
    TESSERA_ASSIGN_OR_RETURN(
        const SignedRequest request,
        client.SignPut(key, Sha256Hex(content), static_cast<int64_t>(content.size()), kProbe_s, hash));
    return transfers.Put(request, file, 0, static_cast<int64_t>(content.size())).status();
  };
  const auto find_out = [&]() -> StatusOr<std::optional<SignedHash>> {
    for (const SignedHash hash : {SignedHash::kContent, SignedHash::kChecksum}) {
      const Status wrong = send(hash, wrong_file);
      if (IsOutage(wrong)) return wrong;
      if (wrong.ok()) continue;
      const Status right = send(hash, right_file);
      if (IsOutage(right)) return right;
      if (right.ok()) return std::optional(hash);
    }
    const Status unhashed = send(SignedHash::kNone, right_file);
    if (IsOutage(unhashed)) return unhashed;
    return unhashed.ok() ? std::optional(SignedHash::kNone) : std::nullopt;
  };
  const StatusOr<std::optional<SignedHash>> hash = find_out();
  const Status removed = client.Delete({key});
  if (hash.ok()) TESSERA_RETURN_IF_ERROR(removed);
  return hash;
}

}  // namespace tessera
