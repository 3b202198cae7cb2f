#include "common/meshio/byte_source.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "common/storage/files.h"

namespace tessera {
namespace {

constexpr size_t kWindowBytes = size_t{1} << 20;

}  // namespace

StatusOr<std::unique_ptr<ByteSource>> ByteSource::Open(const std::string& path) {
  std::unique_ptr<ByteSource> source(new ByteSource());
  source->path_ = path;
  source->fd_ = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat info {};
  if (source->fd_ < 0 || fstat(source->fd_, &info) != 0) return FileError(errno, path);
  if (!S_ISREG(info.st_mode)) return InputError(path, "", "a folder or device", "a regular file");
  source->size_bytes_ = info.st_size;
  source->drained_ = false;
  source->window_.resize(kWindowBytes);
  source->window_begin_ = source->next_ = source->end_ = source->window_.data();
  return source;
}

std::unique_ptr<ByteSource> ByteSource::FromMemory(const std::string& bytes) {
  std::unique_ptr<ByteSource> source(new ByteSource());
  source->size_bytes_ = static_cast<int64_t>(bytes.size());
  source->window_begin_ = source->next_ = bytes.data();
  source->end_ = bytes.data() + bytes.size();
  return source;
}

ByteSource::~ByteSource() {
  if (fd_ >= 0) close(fd_);
}

bool ByteSource::Fill(size_t size) {
  const size_t left = static_cast<size_t>(end_ - next_);
  if (drained_) return left >= size;
  window_offset_bytes_ += next_ - window_begin_;
  if (left > 0) std::memmove(window_.data(), next_, left);
  if (window_.size() < size) window_.resize(std::max(size, 2 * window_.size()));
  size_t filled = left;
  while (filled < window_.size()) {
    const ssize_t got = read(fd_, window_.data() + filled, window_.size() - filled);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) status_ = FileError(errno, path_);
    if (got <= 0) {
      drained_ = true;
      break;
    }
    filled += static_cast<size_t>(got);
  }
  window_begin_ = next_ = window_.data();
  end_ = next_ + filled;
  return filled >= size;
}

bool ByteSource::Skip(uint64_t size) {
  while (size > 0) {
    if (Peek(1) == nullptr) return false;
    const uint64_t part = std::min<uint64_t>(size, static_cast<uint64_t>(end_ - next_));
    next_ += part;
    size -= part;
  }
  return true;
}

bool ByteSource::SkipByteOrderMark() {
  constexpr std::string_view kMark = "\xef\xbb\xbf";
  const char* const bytes = Peek(kMark.size());
  if (bytes == nullptr || std::string_view(bytes, kMark.size()) != kMark) return false;
  Advance(kMark.size());
  return true;
}

bool ByteSource::NextLine(std::string_view& line, size_t max_bytes) {
  size_t searched = 0;
  while (true) {
    const size_t available = static_cast<size_t>(end_ - next_);
    const void* found = available > searched ? std::memchr(next_ + searched, '\n', available - searched) : nullptr;
    size_t length = available;
    if (found != nullptr) {
      length = static_cast<size_t>(static_cast<const char*>(found) - next_);
    } else if (available <= max_bytes && Fill(available + 1)) {
      searched = available;
      continue;
    }
    if (length > max_bytes || (found == nullptr && length == 0)) return false;
    line = std::string_view(next_, length);
    next_ += length + (found != nullptr ? 1 : 0);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    return true;
  }
}

}  // namespace tessera
