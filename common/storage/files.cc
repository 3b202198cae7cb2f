#include "common/storage/files.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <utility>

#include "absl/strings/cord.h"
#include "absl/strings/escaping.h"
#include "common/storage/temporary_name.h"

namespace tessera {
namespace fs = std::filesystem;
namespace {

constexpr char kFileErrorPayload[] = "tessera/errno";

Status SystemError(const std::string& what, const std::string& path, int error) {
  return FileError(error, what + " " + path);
}

// Closes the file on destruction.
class OpenFile {
 public:
  OpenFile(const std::string& path, int flags, mode_t mode = 0644)
      : fd_(::open(path.c_str(), flags | O_CLOEXEC, mode)), error_(fd_ < 0 ? errno : 0) {}
  ~OpenFile() {
    if (fd_ >= 0) ::close(fd_);
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  bool ok() const { return fd_ >= 0; }
  int fd() const { return fd_; }
  int error() const { return error_; }

 private:
  int fd_;
  int error_;
};

std::string FolderOf(const std::string& path) {
  const std::string folder = fs::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

}  // namespace

std::string UniqueName() {
  char random[16];
  if (::getentropy(random, sizeof(random)) != 0) std::abort();  // fails only if the kernel has no random numbers
  return absl::BytesToHexString({random, sizeof(random)});
}

Status FileError(int error, const std::string& what) {
  const std::string message = what + ": " + std::strerror(error);
  Status status;
  switch (error) {
    case ENOENT:
    case ENOTDIR:
      return absl::NotFoundError(message);
    case EACCES:
    case EPERM:
    case EROFS:
      status = absl::PermissionDeniedError(message);
      break;
    case ENOSPC:
    case EDQUOT:
    case EFBIG:
    case EMFILE:
    case ENFILE:
      status = absl::ResourceExhaustedError(message);
      break;
    default:
      status = absl::InternalError(message);
  }
  status.SetPayload(kFileErrorPayload, absl::Cord(std::to_string(error)));
  return status;
}

bool IsFileError(const Status& status) { return status.GetPayload(kFileErrorPayload).has_value(); }

StatusOr<std::string> ReadFileRange(const std::string& path, int64_t offset_bytes, int64_t size_bytes) {
  OpenFile file(path, O_RDONLY);
  if (!file.ok()) return SystemError("cannot open", path, file.error());
  return ReadRange(file.fd(), path, offset_bytes, size_bytes);
}

StatusOr<std::string> ReadRange(int fd, const std::string& path, int64_t offset_bytes, int64_t size_bytes) {
  std::string content(static_cast<size_t>(size_bytes), '\0');
  size_t filled = 0;
  while (filled < content.size()) {
    const ssize_t got = ::pread(fd, content.data() + filled, content.size() - filled,
                                static_cast<off_t>(offset_bytes + static_cast<int64_t>(filled)));
    if (got < 0) {
      if (errno == EINTR) continue;
      return SystemError("cannot read", path, errno);
    }
    if (got == 0) break;
    filled += static_cast<size_t>(got);
  }
  content.resize(filled);
  return content;
}

Status WriteAll(int fd, std::string_view bytes, const std::string& what) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno != EINTR) return FileError(errno, what);
    if (written > 0) bytes.remove_prefix(static_cast<size_t>(written));
  }
  return absl::OkStatus();
}

StatusOr<std::string> ReadFile(const std::string& path, int64_t max_bytes) {
  TESSERA_ASSIGN_OR_RETURN(const FileStamp stamp, StampOf(path));
  if (stamp.size_bytes > max_bytes) {
    return absl::ResourceExhaustedError(path + " has " + std::to_string(stamp.size_bytes) + " bytes, more than " +
                                        std::to_string(max_bytes));
  }
  return ReadFileRange(path, 0, stamp.size_bytes);
}

Status SyncPath(const std::string& path) {
  OpenFile file(path, O_RDONLY);
  if (!file.ok()) return SystemError("cannot open", path, file.error());
  // EINVAL: the file system cannot sync folders.
  if (::fsync(file.fd()) != 0 && errno != EINVAL) return SystemError("cannot sync", path, errno);
  return absl::OkStatus();
}

Status RenameDurably(const std::string& from, const std::string& to) {
  if (::rename(from.c_str(), to.c_str()) != 0) return SystemError("cannot rename " + from + " to", to, errno);
  return SyncPath(FolderOf(to));
}

Status WriteFileAtomic(const std::string& path, const std::string& content, mode_t mode) {
  const std::string temporary = TemporaryBeside(path);
  Status status;
  {
    OpenFile file(temporary, O_WRONLY | O_CREAT | O_EXCL, mode);
    if (!file.ok()) return SystemError("cannot create", path, file.error());
    status = WriteAll(file.fd(), content, "cannot write " + path);
    if (status.ok() && ::fsync(file.fd()) != 0) status = SystemError("cannot sync", path, errno);
  }
  if (status.ok()) status = RenameDurably(temporary, path);
  if (!status.ok()) ::unlink(temporary.c_str());
  return status;
}

Status CopyFileDurably(const std::string& from, const std::string& to) {
  OpenFile source(from, O_RDONLY);
  if (!source.ok()) return SystemError("cannot open", from, source.error());
  OpenFile target(to, O_WRONLY | O_CREAT | O_EXCL);
  if (!target.ok()) return SystemError("cannot create", to, target.error());
  std::string buffer(1 << 20, '\0');
  while (true) {
    const ssize_t got = ::read(source.fd(), buffer.data(), buffer.size());
    if (got < 0) {
      if (errno == EINTR) continue;
      return SystemError("cannot read", from, errno);
    }
    if (got == 0) break;
    TESSERA_RETURN_IF_ERROR(WriteAll(target.fd(), {buffer.data(), static_cast<size_t>(got)}, "cannot write " + to));
  }
  if (::fsync(target.fd()) != 0) return SystemError("cannot sync", to, errno);
  return absl::OkStatus();
}

std::string AbsolutePath(const std::string& path) {
  std::error_code error;
  const fs::path absolute = fs::absolute(path, error);
  std::string normal = (error ? fs::path(path) : absolute).lexically_normal().string();
  while (normal.size() > 1 && normal.back() == '/') normal.pop_back();
  return normal;
}

Status EnsureFolder(const std::string& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (error) return SystemError("cannot create folder", path, error.value());
  if (!fs::is_directory(path, error)) return absl::InternalError("not a folder: " + path);
  return absl::OkStatus();
}

Status EnsurePrivateFolder(const std::string& path) {
  TESSERA_RETURN_IF_ERROR(EnsureFolder(path));
  const fs::perms others = fs::perms::group_all | fs::perms::others_all;
  std::error_code error;
  const auto close = [&](const fs::path& entry) {
    if (!error) fs::permissions(entry, others, fs::perm_options::remove | fs::perm_options::nofollow, error);
    if (error == std::errc::operation_not_supported) error.clear();  // a link
  };
  if ((fs::status(path, error).permissions() & others) == fs::perms::none) return absl::OkStatus();
  for (fs::recursive_directory_iterator it(path, error); !error && it != fs::recursive_directory_iterator();
       it.increment(error)) {
    if (!it->is_symlink()) close(it->path());
  }
  close(path);  // last, so that an interrupted call is repeated in full
  if (error) return SystemError("cannot remove other users' access to", path, error.value());
  return absl::OkStatus();
}

Status RemoveTree(const std::string& path) {
  std::error_code error;
  fs::remove_all(path, error);
  if (error) return SystemError("cannot remove", path, error.value());
  return absl::OkStatus();
}

StatusOr<std::vector<std::string>> ListFiles(const std::string& folder) {
  std::vector<std::string> files;
  std::error_code error;
  fs::recursive_directory_iterator it(folder, fs::directory_options::follow_directory_symlink, error);
  if (error) return SystemError("cannot list", folder, error.value());
  for (; it != fs::recursive_directory_iterator(); it.increment(error)) {
    if (error) return SystemError("cannot list", folder, error.value());
    std::error_code type_error;
    if (it->is_regular_file(type_error)) files.push_back(it->path().lexically_relative(folder).string());
  }
  if (error) return SystemError("cannot list", folder, error.value());
  std::sort(files.begin(), files.end());
  return files;
}

bool FileExists(const std::string& path) {
  struct stat info;
  return ::stat(path.c_str(), &info) == 0;
}

StatusOr<FileStamp> StampOf(const std::string& path) {
  struct stat info;
  if (::stat(path.c_str(), &info) != 0) return SystemError("cannot read", path, errno);
  if (!S_ISREG(info.st_mode)) return absl::InvalidArgumentError(path + " is not a regular file");
  return FileStamp{info.st_size, int64_t{info.st_mtim.tv_sec} * 1'000'000'000 + info.st_mtim.tv_nsec};
}

StatusOr<std::string> JoinInside(const std::string& folder, const std::string& name) {
  const fs::path path(name);
  bool good = !name.empty() && path.is_relative() && name.back() != '/' && name.find('\0') == std::string::npos;
  for (const fs::path& part : path) good = good && part != ".." && part != "." && !part.empty();
  if (!good) return absl::InvalidArgumentError("not a relative file name: '" + name + "'");
  return (fs::path(folder) / path).string();
}

StatusOr<TempFolder> TempFolder::Create(const std::string& parent, const std::string& prefix) {
  std::error_code error;
  std::string base = parent.empty() ? fs::temp_directory_path(error).string() : parent;
  if (error) return SystemError("cannot use folder for temporary files", base, error.value());
  TESSERA_RETURN_IF_ERROR(EnsureFolder(base));
  std::string path = (fs::path(base) / (prefix + "XXXXXX")).string();
  if (::mkdtemp(path.data()) == nullptr) return SystemError("cannot create folder", path, errno);
  return TempFolder(std::move(path));
}

TempFolder::TempFolder(TempFolder&& other) noexcept : path_(std::exchange(other.path_, "")) {}

TempFolder& TempFolder::operator=(TempFolder&& other) noexcept {
  std::swap(path_, other.path_);
  return *this;
}

TempFolder::~TempFolder() {
  std::error_code error;
  if (!path_.empty()) fs::remove_all(path_, error);
}

StatusOr<FileLock> FileLock::Acquire(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd < 0) return SystemError("cannot open", path, errno);
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
    const int error = errno;
    ::close(fd);
    if (error == EWOULDBLOCK) return absl::FailedPreconditionError(path + " is locked by another process");
    return SystemError("cannot lock", path, error);
  }
  return FileLock(fd);
}

FileLock::FileLock(FileLock&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

FileLock& FileLock::operator=(FileLock&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}

FileLock::~FileLock() {
  if (fd_ >= 0) ::close(fd_);
}

}  // namespace tessera
