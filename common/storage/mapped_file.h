// Memory-mapped files and scratch arrays on disk, for data larger than memory. The system evicts their pages from the
// page cache when memory is short.
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

// A mapped file. Movable; const members are thread-safe. Truncating a mapped file ends the process (SIGBUS), so files
// must not be changed in place.
class MappedFile {
 public:
  MappedFile() = default;  // empty
  // Read-only. Errors as ReadFile.
  static StatusOr<MappedFile> Open(const std::string& path);
  // A new writable, unnamed file of `size_bytes` zeros in `folder`, deleted with this object. Reserves its disk space:
  // RESOURCE_EXHAUSTED if there is too little.
  static StatusOr<MappedFile> Scratch(const std::string& folder, size_t size_bytes);
  MappedFile(MappedFile&& other) noexcept { *this = std::move(other); }
  MappedFile& operator=(MappedFile&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_bytes_, other.size_bytes_);
    return *this;
  }
  ~MappedFile();

  const char* data() const { return data_; }
  char* mutable_data() { return data_; }  // for scratch files only
  size_t size_bytes() const { return size_bytes_; }
  // Removes whole pages of the range from this process's memory. The next access maps them again; data written to a
  // scratch file is kept.
  void Release(size_t offset, size_t size_bytes) const;

 private:
  friend class ScratchBytes;
  static StatusOr<MappedFile> Map(int fd, size_t size_bytes, bool writable, const std::string& path);
  char* data_ = nullptr;
  size_t size_bytes_ = 0;
};

// A fixed number of values on disk, initially zero. Movable.
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

// Appends bytes to an unnamed file and maps it at the end. Not thread-safe.
class ScratchBytes {
 public:
  static StatusOr<std::unique_ptr<ScratchBytes>> Create(const std::string& folder);
  ~ScratchBytes();
  ScratchBytes(const ScratchBytes&) = delete;
  ScratchBytes& operator=(const ScratchBytes&) = delete;

  // Finish returns the error of a failed write.
  void Append(const void* data, size_t size_bytes);
  int64_t size_bytes() const { return size_bytes_; }
  // All appended bytes, writable. Append must not be called afterwards.
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

// ScratchBytes for values of one type.
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
