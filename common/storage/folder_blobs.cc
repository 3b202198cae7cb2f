#include "common/storage/folder_blobs.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <utility>

#include "common/storage/files.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using Kind = BlobEntry::Kind;

constexpr char kQuarantine[] = "/quarantine", kPartial[] = "/partial";
constexpr int kQuarantinePart = BlobStore::kParts - 1, kPartialPart = BlobStore::kParts - 2;

// Copies `from` to `to`, durably, and returns the digest of the written bytes.
StatusOr<Digest> CopyAndHash(const std::string& from, const std::string& to) {
  TESSERA_RETURN_IF_ERROR(CopyFileDurably(from, to));
  return HashFile(to);
}

int64_t Micros(const timespec& time) { return time.tv_sec * 1'000'000 + time.tv_nsec / 1000; }

// Storing an existing blob sets its access time only, so this may be later than the modification time.
int64_t StoredSince(const struct stat& info) { return std::max(Micros(info.st_mtim), Micros(info.st_atim)); }

Status NoBlob(const Digest& digest) { return absl::NotFoundError("no blob " + digest.sha256); }

std::string HashesTo(const Digest& found, const Digest& expected) {
  return "found " + std::to_string(found.size_bytes) + " bytes with SHA-256 " + found.sha256 + ", expected " +
         std::to_string(expected.size_bytes) + " with its name as SHA-256";
}

// The folder of a part, and the kind of the files in it.
std::pair<std::string, Kind> FolderOfPart(int part) {
  constexpr char kDigits[] = "0123456789abcdef";
  if (part == kQuarantinePart) return {kQuarantine, Kind::kQuarantined};
  if (part == kPartialPart) return {kPartial, Kind::kLeftover};
  return {std::string{'/', kDigits[part / 16], kDigits[part % 16]}, Kind::kBlob};
}

}  // namespace

StatusOr<std::unique_ptr<FolderBlobs>> FolderBlobs::Open(const std::string& root) {
  TESSERA_RETURN_IF_ERROR(EnsureFolder(root + kPartial));
  return std::unique_ptr<FolderBlobs>(new FolderBlobs(root));
}

std::string FolderBlobs::Path(const Digest& digest) const {
  return root_ + "/" + digest.sha256.substr(0, 2) + "/" + digest.sha256;
}

std::string FolderBlobs::PartialPath(const Digest& digest) const { return root_ + kPartial + "/" + digest.sha256; }

std::string FolderBlobs::NewTemporary() const { return root_ + kPartial + "/put-" + UniqueName(); }

Status FolderBlobs::Stat(const Digest& digest) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  TESSERA_ASSIGN_OR_RETURN(const FileStamp stamp, StampOf(Path(digest)));
  return stamp.size_bytes == digest.size_bytes ? absl::OkStatus() : NoBlob(digest);
}

StatusOr<std::string> FolderBlobs::ReadRange(const Digest& digest, int64_t offset_bytes, int64_t size_bytes) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  return ReadFileRange(Path(digest), offset_bytes, size_bytes);
}

bool FolderBlobs::TouchFile(const Digest& digest) const {
  const timespec times[] = {{0, UTIME_NOW}, {0, UTIME_OMIT}};                            // access, modification
  return ::utimensat(AT_FDCWD, Path(digest).c_str(), times, 0) == 0 || errno != ENOENT;  // EPERM: another user owns it
}

Status FolderBlobs::Touch(const Digest& digest) {
  TESSERA_RETURN_IF_ERROR(Stat(digest));
  return TouchFile(digest) ? absl::OkStatus() : NoBlob(digest);
}

Status FolderBlobs::Verify(const Digest& digest) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  if (!FileExists(Path(digest))) return NoBlob(digest);
  TESSERA_ASSIGN_OR_RETURN(const Digest found, HashFile(Path(digest)));
  if (found == digest) return absl::OkStatus();
  return absl::DataLossError(Path(digest) + " is damaged: " + HashesTo(found, digest));
}

Status FolderBlobs::VerifyOrQuarantine(const Digest& digest) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  const std::string path = Path(digest);
  if (!FileExists(path)) return NoBlob(digest);
  const auto found = HashFile(path);
  if (found.ok() && *found == digest) return absl::OkStatus();
  // The file exists but cannot be opened, perhaps for a moment.
  if (absl::IsNotFound(found.status())) return absl::UnavailableError("cannot open " + path);
  const std::string quarantine = root_ + kQuarantine, moved_to = quarantine + "/" + digest.sha256 + "-" + UniqueName();
  Status moved = EnsureFolder(quarantine);
  if (moved.ok()) moved = RenameDurably(path, moved_to);
  if (!moved.ok()) return absl::UnavailableError("cannot quarantine a damaged blob: " + std::string(moved.message()));
  // Another process may have stored the right content between the read and the rename.
  if (const auto again = HashFile(moved_to); again.ok() && *again == digest) return Publish(moved_to, digest);
  const std::string damage = found.ok() ? HashesTo(*found, digest) : std::string(found.status().message());
  return absl::DataLossError("blob " + digest.sha256 + " was damaged (" + damage + ") and is now " + moved_to);
}

std::optional<int64_t> FolderBlobs::FreeSpace() const {
  std::error_code error;
  const fs::space_info space = fs::space(root_, error);
  if (error) return std::nullopt;
  return static_cast<int64_t>(std::min<uintmax_t>(space.available, std::numeric_limits<int64_t>::max()));
}

Status FolderBlobs::MoveTo(const Digest& digest, const std::string& path) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  return RenameDurably(Path(digest), path);
}

Status FolderBlobs::Publish(const std::string& temporary, const Digest& digest) {
  const std::string folder = root_ + "/" + digest.sha256.substr(0, 2), path = Path(digest);
  Status status = EnsureFolder(folder);
  // Replace an existing file only if it is damaged: readers must not see an intact one change.
  if (status.ok() &&
      (::link(temporary.c_str(), path.c_str()) == 0 || (errno == EEXIST && TouchFile(digest) && Verify(digest).ok()))) {
    std::remove(temporary.c_str());
    return SyncPath(folder);
  }
  if (status.ok()) status = RenameDurably(temporary, path);
  return status;
}

StatusOr<Digest> FolderBlobs::PutFile(const std::string& path) {
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

StatusOr<Digest> FolderBlobs::MoveFile(const std::string& path) {
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

StatusOr<Digest> FolderBlobs::PutBytes(const std::string& bytes) {
  const Digest digest{Sha256Hex(bytes), static_cast<int64_t>(bytes.size())};
  if (TouchFile(digest) && Verify(digest).ok()) return digest;
  TESSERA_RETURN_IF_ERROR(EnsureFolder(root_ + "/" + digest.sha256.substr(0, 2)));
  TESSERA_RETURN_IF_ERROR(WriteFileAtomic(Path(digest), bytes));
  return digest;
}

StatusOr<Digest> FolderBlobs::PutParts(const std::function<void(const Writer& write)>& give) {
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

StatusOr<int64_t> FolderBlobs::CommittedBytes(const Digest& digest) const {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  std::lock_guard lock(UploadMutex(digest));
  if (Has(digest) && TouchFile(digest)) return digest.size_bytes;
  const auto stamp = StampOf(PartialPath(digest));
  return stamp.ok() ? stamp->size_bytes : 0;
}

StatusOr<int64_t> FolderBlobs::Append(const Digest& digest, int64_t offset, const std::string& bytes) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  const int64_t end = offset + static_cast<int64_t>(bytes.size());
  if (offset < 0 || end > digest.size_bytes) {
    return absl::InvalidArgumentError("upload: found bytes " + std::to_string(offset) + " to " + std::to_string(end) +
                                      ", expected at most " + std::to_string(digest.size_bytes));
  }
  std::lock_guard lock(UploadMutex(digest));
  if (Has(digest) && TouchFile(digest)) return digest.size_bytes;
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

Status FolderBlobs::Complete(const Digest& digest) {
  TESSERA_RETURN_IF_ERROR(CheckDigest(digest));
  std::lock_guard lock(UploadMutex(digest));
  if (Has(digest) && TouchFile(digest)) return absl::OkStatus();
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

StatusOr<std::vector<BlobEntry>> FolderBlobs::List(int part) const {
  const auto [folder, kind_of_part] = FolderOfPart(part);
  std::vector<BlobEntry> entries;
  std::error_code error;
  for (fs::directory_iterator it(root_ + folder, error), end; !error && it != end; it.increment(error)) {
    struct stat info {};
    const std::string path = it->path().string(), file = it->path().filename().string();
    if (::lstat(path.c_str(), &info) != 0 || !S_ISREG(info.st_mode)) continue;
    // The rename into quarantine sets only the inode change time.
    const int64_t since_us = kind_of_part == Kind::kQuarantined ? Micros(info.st_ctim) : StoredSince(info);
    BlobEntry entry{kind_of_part, folder.substr(1) + "/" + file, "", info.st_size, since_us};
    if (kind_of_part == Kind::kBlob && CheckDigest({file, entry.size_bytes}).ok()) {
      entry.sha256 = file;
    } else if (kind_of_part == Kind::kBlob) {
      if (file.find(".tmp-") == std::string::npos) continue;
      entry.kind = Kind::kLeftover;
    }
    entries.push_back(std::move(entry));
  }
  return entries;
}

StatusOr<BlobStore::FreeBytes> FolderBlobs::Remove(const BlobEntry& entry) {
  if (entry.kind == Kind::kBlob) TESSERA_RETURN_IF_ERROR(CheckDigest({entry.sha256, entry.size_bytes}));
  const std::string path = entry.kind == Kind::kBlob ? Path({entry.sha256, 0}) : root_ + "/" + entry.name;
  const std::string removed = root_ + kPartial + "/removed-" + UniqueName();
  const auto fault = [&] { return "cannot remove " + path + ": " + std::strerror(errno); };
  if (std::rename(path.c_str(), removed.c_str()) != 0) {
    return errno == ENOENT ? absl::NotFoundError(fault()) : absl::InternalError(fault());
  }
  struct stat info {};
  const bool is_listed_one = entry.kind != Kind::kBlob || entry.since_us == BlobEntry::kAnyTime ||
                             (::lstat(removed.c_str(), &info) == 0 && StoredSince(info) == entry.since_us);
  if (is_listed_one) return FreeBytes([removed] { std::remove(removed.c_str()); });
  if (::link(removed.c_str(), path.c_str()) != 0 && errno != EEXIST) return absl::InternalError(fault());
  std::remove(removed.c_str());
  TESSERA_RETURN_IF_ERROR(SyncPath(fs::path(path).parent_path().string()));
  return absl::NotFoundError(path + " was stored again");
}

}  // namespace tessera
