#include "common/s3_blobs/s3_blobs.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/storage/files.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

using Kind = BlobEntry::Kind;

constexpr char kBlobs[] = "blobs/", kQuarantined[] = "quarantine/";
// Beginnings of the names of entries that are no objects.
constexpr std::string_view kUploadName = "upload ", kStagedName = "staged ";
constexpr int kQuarantinedPart = BlobStore::kParts - 1, kLeftoverPart = BlobStore::kParts - 2;

Status NoObject(const Digest& digest) { return absl::NotFoundError("no blob " + digest.sha256); }

Status OfBlob(const Status& status, const Digest& digest) {
  return absl::IsNotFound(status) ? NoObject(digest) : status;
}

std::string PrefixOfPart(int part) {
  constexpr char kDigits[] = "0123456789abcdef";
  if (part == kQuarantinedPart) return kQuarantined;
  return absl::StrCat(kBlobs, std::string{kDigits[part / 16], kDigits[part % 16], '/'});
}

// "upload ID KEY": neither has a space.
std::string NameOf(const S3Upload& upload) {
  return absl::StrCat(std::string(kUploadName), upload.id, " ", upload.key);
}

S3Upload UploadOfName(const std::string& name) {
  const size_t space = name.find(' ', kUploadName.size());
  if (space == std::string::npos) return {};
  return {.key = name.substr(space + 1), .id = name.substr(kUploadName.size(), space - kUploadName.size())};
}

std::string KeyOfEntry(const BlobEntry& entry) {
  return entry.kind == Kind::kBlob ? S3Blobs::KeyOf({entry.sha256, entry.size_bytes}) : entry.name;
}

// Digest of an object's content.
StatusOr<Digest> HashObject(S3Client& client, const std::string& key) {
  Digest found;
  Sha256Hasher hasher;
  TESSERA_RETURN_IF_ERROR(client.Stream(key, 0, [&](std::string_view bytes) {
    hasher.Update(bytes.data(), bytes.size());
    found.size_bytes += static_cast<int64_t>(bytes.size());
    return absl::OkStatus();
  }));
  found.sha256 = hasher.Finish();
  return found;
}

std::string Difference(const Digest& found, const Digest& expected) {
  return absl::StrCat("found ", found.size_bytes, " bytes with SHA-256 ", found.sha256, ", expected ",
                      expected.size_bytes, " with its name as SHA-256");
}

// All objects whose keys begin with the prefix.
StatusOr<std::vector<S3Object>> ListAll(S3Client& client, const std::string& key_prefix) {
  std::vector<S3Object> objects;
  std::string from;
  do {
    TESSERA_ASSIGN_OR_RETURN(S3Page page, client.List(key_prefix, from));
    for (S3Object& object : page.objects) objects.push_back(std::move(object));
    from = std::move(page.next);
  } while (!from.empty());
  return objects;
}

}  // namespace

std::string S3Blobs::KeyOf(const Digest& digest) {
  return absl::StrCat(kBlobs, digest.sha256.substr(0, 2), "/", digest.sha256);
}

StatusOr<std::unique_ptr<S3Blobs>> S3Blobs::Open(S3Client* client, const Clock* clock, const std::string& staging,
                                                 double grace_s) {
  TESSERA_ASSIGN_OR_RETURN(auto folder, FolderBlobs::Open(staging));
  TESSERA_RETURN_IF_ERROR(client->List(kBlobs).status());  // tells now if the store cannot be used
  return std::unique_ptr<S3Blobs>(new S3Blobs(client, clock, std::move(folder), grace_s));
}

S3ClientOptions S3Blobs::RemovalOptions(S3ClientOptions options) {
  options.connect_s = 1;
  options.silence_s = 2;
  options.retry.max_attempts = 1;
  return options;
}

Status S3Blobs::Stat(const Digest& digest) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  const StatusOr<S3Object> object = client_->Head(KeyOf(digest));
  if (!object.ok()) return OfBlob(object.status(), digest);
  return object->size_bytes == digest.size_bytes ? absl::OkStatus() : NoObject(digest);
}

StatusOr<std::string> S3Blobs::ReadRange(const Digest& digest, int64_t offset_bytes, int64_t size_bytes) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  size_bytes = std::min(size_bytes, digest.size_bytes - offset_bytes);
  if (size_bytes <= 0 && offset_bytes > 0) return std::string();  // S3 refuses empty ranges
  if (digest.size_bytes == 0) {
    TESSERA_RETURN_IF_ERROR(Stat(digest));
    return std::string();
  }
  StatusOr<std::string> bytes = client_->Get(KeyOf(digest), offset_bytes, size_bytes);
  if (!bytes.ok()) return OfBlob(bytes.status(), digest);
  return bytes;
}

Status S3Blobs::Verify(const Digest& digest) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  const StatusOr<Digest> found = HashObject(*client_, KeyOf(digest));
  if (!found.ok()) return OfBlob(found.status(), digest);
  if (*found == digest) return absl::OkStatus();
  return absl::DataLossError(
      absl::StrCat("blob ", digest.sha256, " in ", Location(), " is damaged: ", Difference(*found, digest)));
}

// The object is copied, not renamed: another process may store the right content before it is deleted.
Status S3Blobs::VerifyOrQuarantine(const Digest& digest) {
  const Status damage = Verify(digest);
  if (!absl::IsDataLoss(damage)) return damage;
  const std::string key = KeyOf(digest), moved_to = absl::StrCat(kQuarantined, digest.sha256, "-", UniqueName());
  Status moved = client_->Copy(key, moved_to);
  if (moved.ok()) moved = client_->Delete({key});
  if (!moved.ok()) {
    return absl::UnavailableError(absl::StrCat("cannot quarantine a damaged blob: ", std::string(moved.message())));
  }
  if (const auto copied = HashObject(*client_, moved_to); copied.ok() && *copied == digest) {
    TESSERA_RETURN_IF_ERROR(client_->Copy(moved_to, key));
    return client_->Delete({moved_to});
  }
  return absl::DataLossError(absl::StrCat(std::string(damage.message()), "; it is now ", moved_to));
}

StatusOr<Digest> S3Blobs::PutFile(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const Digest digest, HashFile(path));
  TESSERA_RETURN_IF_ERROR(client_->PutFile(KeyOf(digest), path, digest.size_bytes, digest.sha256));
  return digest;
}

StatusOr<Digest> S3Blobs::MoveFile(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const Digest digest, PutFile(path));
  std::remove(path.c_str());
  return digest;
}

StatusOr<Digest> S3Blobs::PutBytes(const std::string& bytes) {
  const Digest digest{Sha256Hex(bytes), static_cast<int64_t>(bytes.size())};
  TESSERA_RETURN_IF_ERROR(client_->Put(KeyOf(digest), bytes, digest.sha256));
  return digest;
}

StatusOr<Digest> S3Blobs::PutParts(const std::function<void(const Writer& write)>& give) {
  TESSERA_ASSIGN_OR_RETURN(const Digest digest, staging_->PutParts(give));
  const std::string path = *staging_->LocalPath(digest);
  const Status stored = client_->PutFile(KeyOf(digest), path, digest.size_bytes, digest.sha256);
  std::remove(path.c_str());
  if (!stored.ok()) return stored;
  return digest;
}

Status S3Blobs::Renew(const Digest& digest) const {
  const std::shared_lock lock(renewal_mutex_);
  const StatusOr<S3Object> object = client_->Head(KeyOf(digest));
  if (!object.ok()) return OfBlob(object.status(), digest);
  if (object->size_bytes != digest.size_bytes) return NoObject(digest);
  if (clock_->UnixTimeUs() - object->modified_us < static_cast<int64_t>(grace_s_ / 2 * 1e6)) return absl::OkStatus();
  return OfBlob(client_->Renew(KeyOf(digest)), digest);
}

Status S3Blobs::Touch(const Digest& digest) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  return Renew(digest);
}

// Asks the store only before the first bytes are staged.
StatusOr<int64_t> S3Blobs::CommittedBytes(const Digest& digest) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  std::lock_guard lock(UploadMutex(digest));
  TESSERA_ASSIGN_OR_RETURN(const int64_t staged, staging_->CommittedBytes(digest));
  if (staged > 0) return staged;
  const Status stored = Renew(digest);
  if (stored.ok()) return digest.size_bytes;
  if (!absl::IsNotFound(stored)) return stored;
  return 0;
}

StatusOr<int64_t> S3Blobs::Append(const Digest& digest, int64_t offset, const std::string& bytes) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  std::lock_guard lock(UploadMutex(digest));
  TESSERA_ASSIGN_OR_RETURN(const int64_t staged, staging_->CommittedBytes(digest));
  const Status stored = staged > 0 ? NoObject(digest) : Renew(digest);
  if (absl::IsNotFound(stored)) return staging_->Append(digest, offset, bytes);
  TESSERA_RETURN_IF_ERROR(stored);
  return digest.size_bytes;
}

Status S3Blobs::Complete(const Digest& digest) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  std::lock_guard lock(UploadMutex(digest));
  if (const Status stored = Renew(digest); !absl::IsNotFound(stored)) return stored;
  TESSERA_RETURN_IF_ERROR(staging_->Complete(digest));
  const std::string path = *staging_->LocalPath(digest);
  TESSERA_RETURN_IF_ERROR(client_->PutFile(KeyOf(digest), path, digest.size_bytes, digest.sha256));
  std::remove(path.c_str());
  return absl::OkStatus();
}

StatusOr<std::vector<BlobEntry>> S3Blobs::List(int part) const {
  std::vector<BlobEntry> entries;
  if (part == kLeftoverPart) {
    for (int staged = 0; staged < kParts; ++staged) {
      TESSERA_ASSIGN_OR_RETURN(std::vector<BlobEntry> files, staging_->List(staged));
      for (BlobEntry& file : files) {
        // A staged blob whose transfer to the store failed has a digest as its name in the folder.
        const std::string name = absl::StrCat(std::string(kStagedName), file.name);
        entries.push_back({Kind::kLeftover, name, "", file.size_bytes, file.since_us});
      }
    }
    TESSERA_ASSIGN_OR_RETURN(const std::vector<S3Upload> uploads, client_->ListUploads(kBlobs));
    for (const S3Upload& upload : uploads)
      entries.push_back({Kind::kLeftover, NameOf(upload), "", 0, upload.started_us});
    return entries;
  }
  const std::string prefix = PrefixOfPart(part);
  TESSERA_ASSIGN_OR_RETURN(const std::vector<S3Object> objects, ListAll(*client_, prefix));
  for (const S3Object& object : objects) {
    BlobEntry entry{Kind::kQuarantined, object.key, "", object.size_bytes, object.modified_us};
    if (part != kQuarantinedPart) {
      entry.kind = Kind::kBlob;
      entry.sha256 = object.key.substr(prefix.size());
      if (!CheckDigest({entry.sha256, entry.size_bytes}).ok()) continue;
    }
    entries.push_back(std::move(entry));
  }
  return entries;
}

StatusOr<std::vector<BlobEntry>> S3Blobs::Unchanged(const std::vector<BlobEntry>& entries) const {
  // One listing for all of a part, which has the times as they were listed (Head tells only seconds).
  std::string prefix = KeyOfEntry(entries.front());
  for (const BlobEntry& entry : entries) {
    const std::string key = KeyOfEntry(entry);
    prefix.resize(std::mismatch(prefix.begin(), prefix.end(), key.begin(), key.end()).first - prefix.begin());
  }
  TESSERA_ASSIGN_OR_RETURN(const std::vector<S3Object> objects, ListAll(*remover_, prefix));
  std::map<std::string, int64_t> times;
  for (const S3Object& object : objects) times[object.key] = object.modified_us;
  std::vector<BlobEntry> unchanged;
  for (const BlobEntry& entry : entries) {
    const auto time = times.find(KeyOfEntry(entry));
    if (time == times.end()) continue;
    if (entry.since_us == BlobEntry::kAnyTime || entry.since_us == time->second) unchanged.push_back(entry);
  }
  return unchanged;
}

StatusOr<BlobStore::Removed> S3Blobs::RemoveAll(const std::vector<BlobEntry>& entries,
                                                const std::function<bool()>& may_remove) {
  Removed removed;
  removed.free_bytes = [] {};
  const auto check = [&]() -> Status {
    return may_remove && !may_remove() ? absl::CancelledError("blobs may not be removed now") : absl::OkStatus();
  };
  std::map<std::string, std::vector<BlobEntry>> objects;  // by the first characters of their keys: a part of List
  for (const BlobEntry& entry : entries) {
    if (entry.kind != Kind::kLeftover) {
      if (entry.kind == Kind::kBlob) TESSERA_RETURN_IF_ERROR(CheckDigest({entry.sha256, entry.size_bytes}));
      objects[KeyOfEntry(entry).substr(0, sizeof(kBlobs) + 1)].push_back(entry);
      continue;
    }
    Status status = check();
    TESSERA_RETURN_IF_ERROR(status);
    if (entry.name.starts_with(kStagedName)) {
      const auto free_bytes =
          staging_->Remove({Kind::kLeftover, entry.name.substr(kStagedName.size()), "", 0, entry.since_us});
      if (free_bytes.ok()) (*free_bytes)();
      status = free_bytes.status();
    } else {
      const S3Upload upload = UploadOfName(entry.name);
      status = remover_->AbortUpload(upload.key, upload.id);
    }
    if (absl::IsNotFound(status)) continue;
    TESSERA_RETURN_IF_ERROR(status);
    removed.entries.push_back(entry);
  }
  for (const auto& [prefix, listed] : objects) {
    const std::unique_lock lock(renewal_mutex_);
    TESSERA_ASSIGN_OR_RETURN(const std::vector<BlobEntry> unchanged, Unchanged(listed));
    std::vector<std::string> keys;
    for (const BlobEntry& entry : unchanged) keys.push_back(KeyOfEntry(entry));
    TESSERA_RETURN_IF_ERROR(check());  // the listing may have taken long
    if (!keys.empty()) TESSERA_RETURN_IF_ERROR(remover_->Delete(keys));
    removed.entries.insert(removed.entries.end(), unchanged.begin(), unchanged.end());
  }
  return removed;
}

StatusOr<BlobStore::FreeBytes> S3Blobs::Remove(const BlobEntry& entry) {
  TESSERA_ASSIGN_OR_RETURN(Removed removed, RemoveAll({entry}, {}));
  if (removed.entries.empty()) {
    return absl::NotFoundError(absl::StrCat("cannot remove ", KeyOfEntry(entry), ": missing, or stored again"));
  }
  return std::move(removed.free_bytes);
}

}  // namespace tessera
