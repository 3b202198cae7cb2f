#include "common/storage/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>

#include "absl/strings/str_cat.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr size_t kBufferBytes = size_t{1} << 18;

// Descriptor of a new, unnamed file in `folder`.
StatusOr<int> OpenNameless(const std::string& folder) {
  std::string path = absl::StrCat(folder, "/scratch-XXXXXX");
  const int fd = mkostemp(path.data(), O_CLOEXEC);
  if (fd < 0) return FileError(errno, absl::StrCat("cannot create a scratch file in ", folder));
  unlink(path.c_str());
  return fd;
}

}  // namespace

StatusOr<MappedFile> MappedFile::Map(int fd, size_t size_bytes, bool writable, const std::string& path) {
  MappedFile file;
  if (size_bytes == 0) return file;
  void* data = mmap(nullptr, size_bytes, writable ? PROT_READ | PROT_WRITE : PROT_READ,
                    writable ? MAP_SHARED : MAP_PRIVATE, fd, 0);
  if (data == MAP_FAILED) return FileError(errno, absl::StrCat("cannot map ", path));
  file.data_ = static_cast<char*>(data);
  file.size_bytes_ = size_bytes;
  return file;
}

void MappedFile::Release(size_t offset, size_t size_bytes) const {
  const size_t page = static_cast<size_t>(sysconf(_SC_PAGESIZE));
  const size_t begin = (offset + page - 1) / page * page, end = (offset + size_bytes) / page * page;
  if (begin < end) madvise(data_ + begin, end - begin, MADV_DONTNEED);
}

StatusOr<MappedFile> MappedFile::Open(const std::string& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return FileError(errno, absl::StrCat("cannot open ", path));
  struct stat info {};
  StatusOr<MappedFile> file = fstat(fd, &info) == 0
                                  ? Map(fd, static_cast<size_t>(info.st_size), false, path)
                                  : StatusOr<MappedFile>(FileError(errno, absl::StrCat("cannot stat ", path)));
  close(fd);
  return file;
}

StatusOr<MappedFile> MappedFile::Scratch(const std::string& folder, size_t size_bytes) {
  TESSERA_ASSIGN_OR_RETURN(const int fd, OpenNameless(folder));
  // Reserve the space now: on a full disk, the first write to a page would end the process (SIGBUS).
  const int error = size_bytes > 0 ? posix_fallocate(fd, 0, static_cast<off_t>(size_bytes)) : 0;
  StatusOr<MappedFile> file =
      error == 0 ? Map(fd, size_bytes, true, folder)
                 : StatusOr<MappedFile>(
                       FileError(error, absl::StrCat("cannot reserve ", size_bytes, " bytes of scratch in ", folder)));
  close(fd);
  return file;
}

MappedFile::~MappedFile() {
  if (data_ != nullptr) munmap(data_, size_bytes_);
}

ScratchBytes::ScratchBytes(int fd, std::string folder) : fd_(fd), folder_(std::move(folder)) {
  buffer_.reserve(kBufferBytes);
}

StatusOr<std::unique_ptr<ScratchBytes>> ScratchBytes::Create(const std::string& folder) {
  TESSERA_ASSIGN_OR_RETURN(const int fd, OpenNameless(folder));
  return std::unique_ptr<ScratchBytes>(new ScratchBytes(fd, folder));
}

ScratchBytes::~ScratchBytes() {
  if (fd_ >= 0) close(fd_);
}

void ScratchBytes::Append(const void* data, size_t size_bytes) {
  if (buffer_.size() + size_bytes > kBufferBytes) Flush();
  buffer_.append(static_cast<const char*>(data), size_bytes);
  size_bytes_ += static_cast<int64_t>(size_bytes);
}

void ScratchBytes::Flush() {
  if (status_.ok()) status_ = WriteAll(fd_, buffer_, absl::StrCat("scratch file in ", folder_));
  buffer_.clear();
}

StatusOr<MappedFile> ScratchBytes::Finish() {
  Flush();
  buffer_ = std::string();
  TESSERA_RETURN_IF_ERROR(status_);
  StatusOr<MappedFile> file = MappedFile::Map(fd_, static_cast<size_t>(size_bytes_), true, folder_);
  close(fd_);
  fd_ = -1;
  return file;
}

}  // namespace tessera
