#include "common/imaging/file_bytes.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "absl/strings/str_cat.h"

namespace tessera {
namespace {

class FileHandle {
 public:
  explicit FileHandle(int fd) : fd_(fd) {}
  ~FileHandle() {
    if (fd_ >= 0) close(fd_);
  }
  FileHandle(const FileHandle&) = delete;
  FileHandle& operator=(const FileHandle&) = delete;
  int fd() const { return fd_; }
  bool Close() {
    const int fd = fd_;
    fd_ = -1;
    return close(fd) == 0;
  }

 private:
  int fd_;
};

Status WriteError(const std::string& path) {
  return absl::UnavailableError(absl::StrCat(path, ": cannot write: ", std::strerror(errno)));
}

bool WriteAll(int fd, const std::vector<uint8_t>& bytes) {
  for (size_t done = 0; done < bytes.size();) {
    const ssize_t n = write(fd, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return false;
    done += static_cast<size_t>(n);
  }
  return true;
}

}  // namespace

StatusOr<std::vector<uint8_t>> ReadFileBytes(const std::string& path, int64_t limit_bytes) {
  const FileHandle file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat info;
  if (file.fd() < 0 || fstat(file.fd(), &info) != 0) {
    return InputError(path, "", errno == ENOENT ? "no such file" : std::strerror(errno), "a readable file");
  }
  if (!S_ISREG(info.st_mode)) return InputError(path, "", "no regular file", "a readable file");
  std::vector<uint8_t> bytes(static_cast<size_t>(std::min<int64_t>(info.st_size, limit_bytes)));
  for (size_t done = 0; done < bytes.size();) {
    const ssize_t n = read(file.fd(), bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return InputError(path, absl::StrCat("byte ", done), std::strerror(errno), "a readable file");
    if (n == 0) {
      bytes.resize(done);
      break;
    }
    done += static_cast<size_t>(n);
  }
  return bytes;
}

Status ReplaceFile(const std::string& path, const std::vector<uint8_t>& bytes) {
  const std::string temporary = absl::StrCat(path, ".part", getpid());
  {
    FileHandle file(open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666));
    if (file.fd() < 0) return WriteError(path);
    if (!WriteAll(file.fd(), bytes) || fsync(file.fd()) != 0 || !file.Close()) {
      const Status error = WriteError(path);
      unlink(temporary.c_str());
      return error;
    }
  }
  if (rename(temporary.c_str(), path.c_str()) != 0) {
    const Status error = WriteError(path);
    unlink(temporary.c_str());
    return error;
  }
  const size_t slash = path.rfind('/');
  const FileHandle folder(
      open(slash == std::string::npos ? "." : path.substr(0, slash + 1).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (folder.fd() >= 0) fsync(folder.fd());
  return absl::OkStatus();
}

}  // namespace tessera
