// Sequential reading of a file or string through a window, so that files larger than memory can be parsed.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Not thread-safe. Returned pointers are valid until the next call.
class ByteSource {
 public:
  // NOT_FOUND, PERMISSION_DENIED, or INVALID_ARGUMENT if `path` is not a regular file.
  static StatusOr<std::unique_ptr<ByteSource>> Open(const std::string& path);
  // `bytes` must outlive the source.
  static std::unique_ptr<ByteSource> FromMemory(const std::string& bytes);
  ~ByteSource();
  ByteSource(const ByteSource&) = delete;
  ByteSource& operator=(const ByteSource&) = delete;

  // The next `size` bytes, without consuming them; null if fewer are left.
  const char* Peek(size_t size) {
    if (static_cast<size_t>(end_ - next_) < size && !Fill(size)) return nullptr;
    return next_;
  }
  // Consumes bytes that Peek returned.
  void Advance(size_t size) { next_ += size; }
  // Consumes `size` bytes; if fewer are left, consumes all and returns false.
  bool Skip(uint64_t size);
  // Consumes a line and returns it without its line end ("\n" or "\r\n"). False at the end of the source, or if the
  // line is longer than `max_bytes`.
  bool NextLine(std::string_view& line, size_t max_bytes = SIZE_MAX);

  // Consumes a UTF-8 byte order mark; false if there is none.
  bool SkipByteOrderMark();

  bool AtEnd() { return Peek(1) == nullptr; }
  // Bytes consumed so far.
  int64_t offset_bytes() const { return window_offset_bytes_ + (next_ - window_begin_); }
  int64_t size_bytes() const { return size_bytes_; }
  // The error of the last failed read, after which the source behaves as at its end.
  const Status& status() const { return status_; }

 private:
  ByteSource() = default;
  // Makes `size` bytes available from next_ on; false if fewer are left.
  bool Fill(size_t size);

  std::string path_;
  int fd_ = -1;
  int64_t size_bytes_ = 0;
  bool drained_ = true;
  std::vector<char> window_;
  int64_t window_offset_bytes_ = 0;  // offset of window_begin_ in the source
  const char* window_begin_ = nullptr;
  const char* next_ = nullptr;
  const char* end_ = nullptr;
  Status status_;
};

}  // namespace tessera
