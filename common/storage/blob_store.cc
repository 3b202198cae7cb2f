#include "common/storage/blob_store.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>

#include "common/storage/files.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

// Copies `from` to `to` and hashes what it wrote; durable on return.
StatusOr<Digest> CopyAndHash(const std::string& from, const std::string& to) {
  TESSERA_RETURN_IF_ERROR(CopyFileDurably(from, to));
  return HashFile(to);
}

}  // namespace

StatusOr<std::unique_ptr<BlobStore>> BlobStore::Open(const std::string& root) {
  TESSERA_RETURN_IF_ERROR(EnsureFolder(root + "/partial"));
  return std::unique_ptr<BlobStore>(new BlobStore(root));
}

std::string BlobStore::Path(const Digest& digest) const {
  return root_ + "/" + digest.sha256.substr(0, 2) + "/" + digest.sha256;
}

std::string BlobStore::PartialPath(const Digest& digest) const { return root_ + "/partial/" + digest.sha256; }

std::string BlobStore::NewTemporary() const { return root_ + "/partial/put-" + UniqueName(); }

bool BlobStore::Has(const Digest& digest) const {
  if (!CheckDigest(digest).ok()) return false;
  const auto stamp = StampOf(Path(digest));
  return stamp.ok() && stamp->size_bytes == digest.size_bytes;
}

bool BlobStore::Touch(const Digest& digest) const {
  const timespec times[] = {{0, UTIME_NOW}, {0, UTIME_OMIT}};                            // of access, of writing
  return ::utimensat(AT_FDCWD, Path(digest).c_str(), times, 0) == 0 || errno != ENOENT;  // it may be another user's
}

Status BlobStore::Verify(const Digest& digest) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  if (!FileExists(Path(digest))) return absl::NotFoundError("no blob " + digest.sha256);
  TESSERA_ASSIGN_OR_RETURN(const Digest found, HashFile(Path(digest)));
  if (found == digest) return absl::OkStatus();
  return absl::DataLossError(Path(digest) + " is damaged: its " + std::to_string(found.size_bytes) + " bytes hash to " +
                             found.sha256 + ", expected " + std::to_string(digest.size_bytes) +
                             " that hash to its name");
}

Status BlobStore::VerifyOrSetAside(const Digest& digest) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  const std::string path = Path(digest);
  if (!FileExists(path)) return absl::NotFoundError("no blob " + digest.sha256);
  const auto found = HashFile(path);
  if (found.ok() && *found == digest) return absl::OkStatus();
  // It is there and cannot be opened: that passes, or is told by whoever stores.
  if (absl::IsNotFound(found.status())) return absl::UnavailableError("cannot open " + path);
  const std::string aside = root_ + "/set_aside/" + digest.sha256 + "-" + UniqueName();
  Status moved = EnsureFolder(root_ + "/set_aside");
  if (moved.ok()) moved = RenameDurably(path, aside);
  if (!moved.ok()) return absl::UnavailableError("cannot set a damaged blob aside: " + std::string(moved.message()));
  // Between reading and moving somebody may have stored the right content.
  if (const auto again = HashFile(aside); again.ok() && *again == digest) return Publish(aside, digest);
  return absl::DataLossError("blob " + digest.sha256 + " was damaged (" +
                             (found.ok()
                                  ? "its " + std::to_string(found->size_bytes) + " bytes hash to " + found->sha256 +
                                        ", expected " + std::to_string(digest.size_bytes) + " that hash to its name"
                                  : std::string(found.status().message())) +
                             ") and is now " + aside);
}

std::optional<int64_t> BlobStore::FreeBytes() const {
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(root_, error);
  if (error) return std::nullopt;
  return static_cast<int64_t>(std::min<uintmax_t>(space.available, std::numeric_limits<int64_t>::max()));
}

StatusOr<std::string> BlobStore::Read(const Digest& digest, int64_t max_bytes) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  TESSERA_ASSIGN_OR_RETURN(std::string content, ReadFile(Path(digest), max_bytes));
  if (Sha256Hex(content) != digest.sha256) return absl::DataLossError(Path(digest) + " is damaged");
  return content;
}

Status BlobStore::Publish(const std::string& temporary, const Digest& digest) {
  const std::string folder = root_ + "/" + digest.sha256.substr(0, 2), path = Path(digest);
  Status status = EnsureFolder(folder);
  // What is there already stays unless it is damaged: others may be reading it, and would find it changed.
  if (status.ok() &&
      (::link(temporary.c_str(), path.c_str()) == 0 || (errno == EEXIST && Touch(digest) && Verify(digest).ok()))) {
    std::remove(temporary.c_str());
    return SyncPath(folder);
  }
  if (status.ok()) status = RenameDurably(temporary, path);
  return status;
}

StatusOr<Digest> BlobStore::PutFile(const std::string& path) {
  const std::string temporary = NewTemporary();
  const StatusOr<Digest> digest = CopyAndHash(path, temporary);
  if (!digest.ok()) {
    std::remove(temporary.c_str());
    return digest.status();
  }
  const Status published = Publish(temporary, *digest);
  if (published.ok()) return digest;
  std::remove(temporary.c_str());
  return published;
}

StatusOr<Digest> BlobStore::MoveFile(const std::string& path) {
  const std::string temporary = NewTemporary();
  if (std::rename(path.c_str(), temporary.c_str()) != 0) {  // another file system, or no such file
    TESSERA_ASSIGN_OR_RETURN(const Digest digest, PutFile(path));
    std::remove(path.c_str());
    return digest;
  }
  StatusOr<Digest> digest = HashFile(temporary);
  if (digest.ok()) {
    Status stored = SyncPath(temporary);
    if (stored.ok()) stored = Publish(temporary, *digest);
    if (!stored.ok()) digest = stored;
  }
  if (!digest.ok()) {
    std::rename(temporary.c_str(), path.c_str());
    return digest.status();
  }
  return digest;
}

StatusOr<Digest> BlobStore::PutBytes(const std::string& bytes) {
  const Digest digest{Sha256Hex(bytes), static_cast<int64_t>(bytes.size())};
  if (Touch(digest) && Verify(digest).ok()) return digest;
  TESSERA_RETURN_IF_ERROR(EnsureFolder(root_ + "/" + digest.sha256.substr(0, 2)));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(Path(digest), bytes));
  return digest;
}

StatusOr<Digest> BlobStore::PutParts(const std::function<void(const Writer& write)>& give) {
  const std::string temporary = NewTemporary();
  Digest digest;
  Sha256Hasher hasher;
  std::ofstream file(temporary, std::ios::binary);
  give([&](const std::string& bytes) {
    file << bytes;
    hasher.Update(bytes);
    digest.size_bytes += static_cast<int64_t>(bytes.size());
  });
  file.close();
  digest.sha256 = hasher.Finish();
  Status stored = file ? SyncPath(temporary) : absl::ResourceExhaustedError("cannot write " + temporary);
  if (stored.ok()) stored = Publish(temporary, digest);
  if (stored.ok()) return digest;
  std::remove(temporary.c_str());
  return stored;
}

StatusOr<int64_t> BlobStore::CommittedBytes(const Digest& digest) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  std::lock_guard lock(UploadMutex(digest));
  if (Has(digest) && Touch(digest)) return digest.size_bytes;
  const auto stamp = StampOf(PartialPath(digest));
  return stamp.ok() ? stamp->size_bytes : 0;
}

StatusOr<int64_t> BlobStore::Append(const Digest& digest, int64_t offset, const std::string& bytes) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  const int64_t end = offset + static_cast<int64_t>(bytes.size());
  if (offset < 0 || end > digest.size_bytes) {
    return absl::InvalidArgumentError("bytes " + std::to_string(offset) + " to " + std::to_string(end) +
                                      " of a blob of " + std::to_string(digest.size_bytes));
  }
  std::lock_guard lock(UploadMutex(digest));
  if (Has(digest) && Touch(digest)) return digest.size_bytes;
  const std::string path = PartialPath(digest);
  const auto stamp = StampOf(path);
  const int64_t committed = stamp.ok() ? stamp->size_bytes : 0;
  if (offset > committed) {
    return absl::FailedPreconditionError("upload of " + digest.sha256 + " has " + std::to_string(committed) +
                                         " bytes, the next chunk starts at " + std::to_string(offset));
  }
  if (end <= committed) return committed;
  errno = 0;
  std::ofstream file(path, std::ios::binary | std::ios::app);
  file.write(bytes.data() + (committed - offset), end - committed);
  file.close();
  if (!file) return FileError(errno != 0 ? errno : EIO, "cannot write " + path);
  return end;
}

Status BlobStore::Complete(const Digest& digest) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  std::lock_guard lock(UploadMutex(digest));
  if (Has(digest) && Touch(digest)) return absl::OkStatus();
  const std::string path = PartialPath(digest);
  if (digest.size_bytes == 0 && !FileExists(path)) std::ofstream(path, std::ios::binary);
  TESSERA_ASSIGN_OR_RETURN(const Digest found, HashFile(path));
  if (found.size_bytes < digest.size_bytes) {
    return absl::FailedPreconditionError("upload of " + digest.sha256 + " has only " +
                                         std::to_string(found.size_bytes) + " of " + std::to_string(digest.size_bytes) +
                                         " bytes");
  }
  if (found != digest) {
    std::remove(path.c_str());
    return absl::DataLossError("the bytes received hash to " + found.sha256 + ", not to " + digest.sha256 +
                               "; upload dropped");
  }
  TESSERA_RETURN_IF_ERROR(SyncPath(path));
  return Publish(path, digest);
}

}  // namespace tessera
