// Files as memory: what is larger than memory is read and written through the system's page cache, which gives pages
// back when memory is short.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <utility>

#include "common/base/status.h"

namespace tessera {

// Bytes of a file in the address space. Movable; const members are thread-safe. A file that is cut off while it is
// mapped ends the process (SIGBUS): outputs of tasks are never changed in place.
class MappedFile {
 public:
  MappedFile() = default;  // empty
  // Read-only. Errors as ReadFile's.
  static StatusOr<MappedFile> Open(const std::string& path);
  // A new writable file of `size_bytes` zeros in `folder` that has no name and is gone with this object. Its room on
  // disk is reserved: RESOURCE_EXHAUSTED if there is too little.
  static StatusOr<MappedFile> Scratch(const std::string& folder, size_t size_bytes);
  MappedFile(MappedFile&& other) noexcept { *this = std::move(other); }
  MappedFile& operator=(MappedFile&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_bytes_, other.size_bytes_);
    return *this;
  }
  ~MappedFile();

  const char* data() const { return data_; }
  char* mutable_data() { return data_; }  // of scratch files only
  size_t size_bytes() const { return size_bytes_; }
  // Takes whole pages of the range out of this process's memory; of scratch files, what was written stays. Reading
  // brings them back.
  void Release(size_t offset, size_t size_bytes) const;

 private:
  friend class ScratchBytes;
  static StatusOr<MappedFile> Map(int fd, size_t size_bytes, bool writable, const std::string& path);
  char* data_ = nullptr;
  size_t size_bytes_ = 0;
};

// A fixed number of values on disk, zeros at first. Reads and writes go to the page cache. Movable.
template <class T>
class ScratchArray {
  static_assert(alignof(T) <= 4096 && std::is_trivially_destructible_v<T>);

 public:
  ScratchArray() = default;  // no values
  static StatusOr<ScratchArray> Create(const std::string& folder, size_t count) {
    ScratchArray array;
    TESSERA_ASSIGN_OR_RETURN(array.file_, MappedFile::Scratch(folder, count * sizeof(T)));
    return array;
  }
  explicit ScratchArray(MappedFile file) : file_(std::move(file)) {}

  size_t size() const { return file_.size_bytes() / sizeof(T); }
  T& operator[](size_t i) { return reinterpret_cast<T*>(file_.mutable_data())[i]; }
  const T& operator[](size_t i) const { return reinterpret_cast<const T*>(file_.data())[i]; }
  std::span<T> values() { return {reinterpret_cast<T*>(file_.mutable_data()), size()}; }
  std::span<const T> values() const { return {reinterpret_cast<const T*>(file_.data()), size()}; }

 private:
  MappedFile file_;
};

// Bytes that are appended to a file without a name and mapped at the end. Not thread-safe.
class ScratchBytes {
 public:
  static StatusOr<std::unique_ptr<ScratchBytes>> Create(const std::string& folder);
  ~ScratchBytes();
  ScratchBytes(const ScratchBytes&) = delete;
  ScratchBytes& operator=(const ScratchBytes&) = delete;

  // A fault of the disk is kept for Finish.
  void Append(const void* data, size_t size_bytes);
  int64_t size_bytes() const { return size_bytes_; }
  // All that was appended, writable. Nothing may be appended after it.
  StatusOr<MappedFile> Finish();

 private:
  ScratchBytes(int fd, std::string folder);
  void Flush();

  int fd_;
  std::string folder_;
  std::string buffer_;
  int64_t size_bytes_ = 0;
  Status status_;
};

// The same for values.
template <class T>
class ScratchList {
 public:
  static StatusOr<ScratchList> Create(const std::string& folder) {
    TESSERA_ASSIGN_OR_RETURN(std::unique_ptr<ScratchBytes> bytes, ScratchBytes::Create(folder));
    return ScratchList(std::move(bytes));
  }
  void Append(const T& value) { bytes_->Append(&value, sizeof(T)); }
  void Append(std::span<const T> values) { bytes_->Append(values.data(), values.size_bytes()); }
  size_t size() const { return static_cast<size_t>(bytes_->size_bytes()) / sizeof(T); }
  StatusOr<ScratchArray<T>> Finish() {
    TESSERA_ASSIGN_OR_RETURN(MappedFile file, bytes_->Finish());
    return ScratchArray<T>(std::move(file));
  }

 private:
  explicit ScratchList(std::unique_ptr<ScratchBytes> bytes) : bytes_(std::move(bytes)) {}
  std::unique_ptr<ScratchBytes> bytes_;
};

}  // namespace tessera
