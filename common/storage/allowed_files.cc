#include "common/storage/allowed_files.h"

#include <fcntl.h>
#include <linux/magic.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <deque>
#include <filesystem>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "common/base/printable.h"

namespace tessera {
namespace fs = std::filesystem;
namespace {

constexpr int64_t kMaxFileBytes = int64_t{1} << 40;
constexpr int64_t kSparseFromBytes = int64_t{1} << 30;
constexpr int64_t kSparseShare = 16;  // a large file is sparse if less than 1 / kSparseShare of it is on disk
constexpr int64_t kMaxEntries = 1'000'000;
constexpr int kMaxLinks = 40, kMaxDepth = 32;
constexpr size_t kPieceBytes = size_t{1} << 20;

Status Fault(const std::string& path, const std::string& found, const std::string& expected) {
  return InputError(absl::CEscape(path), "", found, expected);
}

std::string KindOf(mode_t mode) {
  if (S_ISDIR(mode)) return "a folder";
  if (S_ISFIFO(mode)) return "a pipe";
  if (S_ISSOCK(mode)) return "a socket";
  if (S_ISCHR(mode) || S_ISBLK(mode)) return "a device";
  return "a file of unknown type";
}

// Whether the file is in a pseudo file system of the kernel.
bool IsPseudo(int fd) {
  struct statfs info;
  if (::fstatfs(fd, &info) != 0) return true;
  const auto type = static_cast<uint64_t>(info.f_type);
  const uint64_t kinds[] = {PROC_SUPER_MAGIC, SYSFS_MAGIC,   CGROUP_SUPER_MAGIC, CGROUP2_SUPER_MAGIC,
                            DEBUGFS_MAGIC,    TRACEFS_MAGIC, SECURITYFS_MAGIC,   DEVPTS_SUPER_MAGIC,
                            BINFMTFS_MAGIC,   BPF_FS_MAGIC,  PSTOREFS_MAGIC};
  return std::find(std::begin(kinds), std::end(kinds), type) != std::end(kinds);
}

// Few blocks alone do not prove a sparse file: some file systems compress zeros. It must have a hole too.
bool IsSparse(int fd, const struct stat& info) {
  if (info.st_size < kSparseFromBytes || info.st_blocks * 512 >= info.st_size / kSparseShare) return false;
  const off_t hole = ::lseek(fd, 0, SEEK_HOLE);
  return hole >= 0 && hole < info.st_size;
}

bool HasControlCharacters(const std::string& path) {
  return std::any_of(path.begin(), path.end(), [](char c) { return static_cast<unsigned char>(c) < 32 || c == 127; });
}

bool IsUnder(const std::string& path, const std::string& folder) {
  return folder == "/" || path == folder || (path.starts_with(folder) && path[folder.size()] == '/');
}

std::string RealPathOf(int fd) {
  char target[PATH_MAX];
  const ssize_t size = ::readlink(absl::StrCat("/proc/self/fd/", fd).c_str(), target, sizeof(target));
  return size > 0 && size < static_cast<ssize_t>(sizeof(target)) ? std::string(target, static_cast<size_t>(size)) : "";
}

}  // namespace

AllowedFile::AllowedFile(AllowedFile&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)), path_(std::move(other.path_)), real_path_(std::move(other.real_path_)) {}

AllowedFile& AllowedFile::operator=(AllowedFile&& other) noexcept {
  std::swap(fd_, other.fd_);
  std::swap(path_, other.path_);
  std::swap(real_path_, other.real_path_);
  return *this;
}

AllowedFile::~AllowedFile() {
  if (fd_ >= 0) ::close(fd_);
}

StatusOr<FileStamp> AllowedFile::Stamp() const {
  struct stat info;
  if (::fstat(fd_, &info) != 0) return FileError(errno, "cannot read " + real_path_);
  return FileStamp{info.st_size, int64_t{info.st_ctim.tv_sec} * 1'000'000'000 + info.st_ctim.tv_nsec};
}

StatusOr<int64_t> AllowedFile::ModifiedNs() const {
  struct stat info;
  if (::fstat(fd_, &info) != 0) return FileError(errno, "cannot read " + real_path_);
  return int64_t{info.st_mtim.tv_sec} * 1'000'000'000 + info.st_mtim.tv_nsec;
}

StatusOr<std::string> AllowedFile::Read(int64_t offset_bytes, int64_t size_bytes) const {
  return ReadRange(fd_, real_path_, offset_bytes, size_bytes);
}

StatusOr<Digest> AllowedFile::Hash(const std::function<bool()>& cancelled) const {
  Sha256Hasher hasher;
  Digest digest;
  while (true) {
    if (cancelled && cancelled()) return absl::CancelledError("cancelled while hashing " + real_path_);
    TESSERA_ASSIGN_OR_RETURN(const std::string piece, Read(digest.size_bytes, kPieceBytes));
    hasher.Update(piece);
    digest.size_bytes += static_cast<int64_t>(piece.size());
    if (piece.size() < kPieceBytes) break;
    if (digest.size_bytes > kMaxFileBytes)
      return absl::ResourceExhaustedError(real_path_ + " grew beyond 1 TiB while it was read");
  }
  digest.sha256 = hasher.Finish();
  return digest;
}

StatusOr<AllowedFiles> AllowedFiles::Under(const std::vector<std::string>& folders) {
  AllowedFiles allowed;
  for (const std::string& folder : folders) {
    std::error_code error;
    const std::string real = fs::canonical(folder, error).string();
    if (error || !fs::is_directory(real, error)) return absl::NotFoundError("not a folder: " + folder);
    allowed.folders_.push_back(real);
    allowed.named_.push_back(fs::absolute(folder).lexically_normal().string());
  }
  return allowed;
}

AllowedFiles AllowedFiles::OwnedBy(uid_t user) {
  AllowedFiles allowed;
  allowed.owner_ = user;
  return allowed;
}

bool AllowedFiles::IsInside(const std::string& real_path) const {
  return folders_.empty() || std::any_of(folders_.begin(), folders_.end(),
                                         [&](const std::string& folder) { return IsUnder(real_path, folder); });
}

bool AllowedFiles::MayPass(const std::string& real_path) const {
  const auto leads_to = [&](const std::string& folder) { return IsUnder(folder, real_path); };
  return IsInside(real_path) || std::any_of(folders_.begin(), folders_.end(), leads_to) ||
         std::any_of(named_.begin(), named_.end(), leads_to);
}

Status AllowedFiles::Outside(const std::string& path) const {
  return Fault(path, "a path outside the allowed folders", "a path in " + absl::StrJoin(folders_, " or "));
}

StatusOr<std::string> AllowedFiles::Resolve(const std::string& path) const {
  if (path.empty() || path[0] != '/' || path.size() >= PATH_MAX) {
    return Fault(path.substr(0, PATH_MAX), "a relative path or one above 4095 bytes", "an absolute path");
  }
  if (HasControlCharacters(path)) return Fault(path, "control characters in its name", "none");
  // Protobuf messages cannot store other names.
  if (!IsUtf8(path)) return Fault(path, "a name that is not UTF-8", "UTF-8");
  std::deque<std::string> rest = absl::StrSplit(path, '/', absl::SkipEmpty());
  std::string real = "/";
  int links = 0;
  while (!rest.empty()) {
    const std::string name = std::move(rest.front());
    rest.pop_front();
    if (name == ".") continue;
    if (name == "..") {
      real = fs::path(real).parent_path().string();
      continue;
    }
    const std::string next = (real == "/" ? "" : real) + "/" + name;
    if (!MayPass(next)) return Outside(path);
    struct stat info;
    if (::lstat(next.c_str(), &info) != 0) return FileError(errno, "cannot read " + absl::CEscape(path));
    if (!S_ISLNK(info.st_mode)) {
      real = next;
      continue;
    }
    std::error_code error;
    const std::string target = fs::read_symlink(next, error).string();
    if (error || ++links > kMaxLinks) return Fault(path, "a link that cannot be resolved", "a file");
    if (target.starts_with("/")) real = "/";
    const std::vector<std::string> names = absl::StrSplit(target, '/', absl::SkipEmpty());
    rest.insert(rest.begin(), names.begin(), names.end());
  }
  if (!IsInside(real)) return Outside(path);
  return real;
}

StatusOr<AllowedFile> AllowedFiles::Open(const std::string& path) const {
  std::string real = path;
  if (restricted()) {
    TESSERA_ASSIGN_OR_RETURN(real, Resolve(path));
  }
  struct stat info;
  if (::stat(real.c_str(), &info) != 0) return FileError(errno, "cannot read " + absl::CEscape(path));
  if (!S_ISREG(info.st_mode)) return Fault(path, KindOf(info.st_mode), "a regular file");
  const int flags = O_RDONLY | O_NONBLOCK | O_CLOEXEC | O_NOCTTY | (restricted() ? O_NOFOLLOW : 0);
  AllowedFile file(::open(real.c_str(), flags), path, real);
  if (file.fd_ < 0) {
    if (errno == ELOOP) return Fault(path, "a link that replaced the file", "a file");
    return FileError(errno, "cannot open " + absl::CEscape(path));
  }
  // Check the open file: any part of the path may have been replaced since Resolve.
  if (::fstat(file.fd_, &info) != 0) return FileError(errno, "cannot read " + absl::CEscape(path));
  if (!S_ISREG(info.st_mode)) return Fault(path, KindOf(info.st_mode), "a regular file");
  if (!restricted()) return file;
  file.path_ = absl::StrCat("/proc/self/fd/", file.fd_);
  file.real_path_ = RealPathOf(file.fd_);
  if (file.real_path_.empty()) return absl::InternalError("cannot resolve the path of " + path + " through /proc");
  if (!IsInside(file.real_path_)) return Outside(path);
  if (owner_ && info.st_uid != *owner_) {
    return Fault(
        path, absl::StrCat("a file of user ", info.st_uid),
        absl::StrCat("a file of user ", *owner_, ", the user of tesserad; --scene-root FOLDER allows other owners"));
  }
  if (IsPseudo(file.fd_)) return Fault(path, "a file of a pseudo file system", "a file on disk");
  if (info.st_size > kMaxFileBytes) {
    return Fault(path, absl::StrCat(info.st_size, " bytes"), absl::StrCat("at most ", kMaxFileBytes));
  }
  if (IsSparse(file.fd_, info)) {
    return Fault(path, absl::StrCat(info.st_size, " bytes of which ", info.st_blocks * 512, " are on disk"),
                 "a file that is not sparse");
  }
  return file;
}

StatusOr<std::string> AllowedFiles::ReadWhole(const std::string& path, int64_t max_bytes) const {
  TESSERA_ASSIGN_OR_RETURN(const AllowedFile file, Open(path));
  TESSERA_ASSIGN_OR_RETURN(const FileStamp stamp, file.Stamp());
  if (stamp.size_bytes > max_bytes) {
    return absl::ResourceExhaustedError(absl::StrCat(path, " has ", stamp.size_bytes, " bytes, more than ", max_bytes));
  }
  return file.Read(0, stamp.size_bytes);
}

bool AllowedFiles::Exists(const std::string& path) const {
  if (!restricted()) return FileExists(path);
  return !absl::IsNotFound(Resolve(path).status());
}

StatusOr<bool> AllowedFiles::IsFolder(const std::string& path) const {
  std::string real = path;
  if (restricted()) {
    auto resolved = Resolve(path);
    if (absl::IsNotFound(resolved.status())) return false;
    TESSERA_ASSIGN_OR_RETURN(real, std::move(resolved));
  }
  std::error_code error;
  return fs::is_directory(real, error);
}

Status AllowedFiles::ListInto(const std::string& folder, const std::string& prefix, std::vector<std::string>& parents,
                              int64_t& entries, std::vector<std::string>& files) const {
  TESSERA_ASSIGN_OR_RETURN(const std::string real, Resolve(folder));
  // A link to a parent folder adds no files.
  if (std::find(parents.begin(), parents.end(), real) != parents.end()) return absl::OkStatus();
  if (parents.size() >= kMaxDepth) return Fault(folder, absl::StrCat(kMaxDepth, " nested folders"), "fewer");
  parents.push_back(real);
  std::error_code error;
  fs::directory_iterator it(real, error);
  for (; !error && it != fs::directory_iterator(); it.increment(error)) {
    if (++entries > kMaxEntries) {
      return absl::ResourceExhaustedError(absl::StrCat(folder, ": more than ", kMaxEntries, " entries in the folder"));
    }
    const std::string name = it->path().filename().string(), path = absl::StrCat(folder, "/", name);
    TESSERA_ASSIGN_OR_RETURN(const bool is_folder, IsFolder(path));
    if (is_folder) {
      TESSERA_RETURN_IF_ERROR(ListInto(path, absl::StrCat(prefix, name, "/"), parents, entries, files));
    } else {
      files.push_back(prefix + name);
    }
  }
  if (error) return FileError(error.value(), "cannot list " + folder);
  parents.pop_back();
  return absl::OkStatus();
}

StatusOr<std::vector<std::string>> AllowedFiles::List(const std::string& folder) const {
  if (!restricted()) return ListFiles(folder);
  std::vector<std::string> files, parents;
  int64_t entries = 0;
  TESSERA_RETURN_IF_ERROR(ListInto(folder, "", parents, entries, files));
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace tessera
