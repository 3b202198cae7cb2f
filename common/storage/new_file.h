// Buffered writing of large new files.
#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/storage/files.h"

namespace tessera {

// Buffered writing of a file that does not exist; the destructor removes the file unless Finish succeeded.
class NewFile {
 public:
  explicit NewFile(const std::string& path)
      : path_(path), fd_(open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666)) {
    if (fd_ < 0) status_ = FileError(errno, path_);
    buffer_.reserve(kBufferBytes);
  }
  ~NewFile() {
    if (fd_ < 0) return;
    close(fd_);
    unlink(path_.c_str());
  }
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;

  void Add(const void* data, size_t size) {
    if (buffer_.size() + size > kBufferBytes) Flush();
    if (!ok()) return;
    buffer_.append(static_cast<const char*>(data), size);
  }
  void Add(std::string_view text) { Add(text.data(), text.size()); }
  bool ok() const { return status_.ok(); }

  // Flushes and syncs the file, and keeps it.
  Status Finish() {
    Flush();
    if (ok() && fsync(fd_) != 0) Fail();
    if (!ok()) return status_;
    const int fd = fd_;
    fd_ = -1;
    if (close(fd) != 0) {
      Fail();
      unlink(path_.c_str());
    }
    return status_;
  }

 private:
  static constexpr size_t kBufferBytes = size_t{1} << 20;

  void Fail() { status_ = FileError(errno, path_); }

  void Flush() {
    if (ok()) status_ = WriteAll(fd_, buffer_, path_);
    buffer_.clear();
  }

  std::string path_;
  int fd_;
  std::string buffer_;
  Status status_;
};

}  // namespace tessera
