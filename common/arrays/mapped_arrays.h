// Reading and writing of array files larger than memory.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "common/arrays/array_file.h"
#include "common/base/status.h"
#include "common/storage/hash.h"
#include "common/storage/mapped_file.h"

namespace tessera {

// A memory-mapped array file. Const members are thread-safe.
class MappedArrays {
 public:
  // Checks the header and the file's size; DATA_LOSS as in ParseArrayFile. Does not read the values: the user of an
  // array checks it with Verify or with checksums of its own.
  static StatusOr<MappedArrays> Open(const std::string& path);

  const std::string& metadata() const { return header_.metadata; }
  const std::string& path() const { return path_; }
  const std::vector<ArrayFileHeader::Entry>& entries() const { return header_.entries; }

  // The array's values, valid as long as this object. DATA_LOSS if it is missing, has another type, or does not have
  // `count` values (-1: any number).
  template <class T>
  StatusOr<std::span<const T>> Get(const std::string& array, int64_t count = -1) const {
    TESSERA_ASSIGN_OR_RETURN(const ArrayFileHeader::Entry* entry,
                             Find(array, ArrayData(std::vector<T>()).index(), count));
    return std::span<const T>(reinterpret_cast<const T*>(file_.data() + entry->offset), entry->count);
  }
  // Verify, then Get.
  template <class T>
  StatusOr<std::span<const T>> Verified(const std::string& array, int64_t count = -1) const {
    TESSERA_RETURN_IF_ERROR(Verify(array));
    return Get<T>(array, count);
  }
  // Compares the array's bytes with their checksum; DATA_LOSS if they differ.
  Status Verify(const std::string& array) const;
  // Releases the array's memory pages; the system reads them again on the next access.
  void Release(const std::string& array) const;

 private:
  StatusOr<const ArrayFileHeader::Entry*> Find(const std::string& array, size_t type, int64_t count) const;

  std::string path_;
  MappedFile file_;
  ArrayFileHeader header_;
};

// Writes an array file piece by piece; the number of values of each array is known in advance. Appends to different
// arrays may alternate, and several threads may append to different arrays. The file equals that of WriteArrayFile,
// byte for byte.
class ArrayFileWriter {
 public:
  struct Array {
    std::string name;
    ArrayData type;  // an empty vector of the array's type
    uint64_t count = 0;
  };
  static StatusOr<std::unique_ptr<ArrayFileWriter>> Create(const std::string& path, const std::string& metadata,
                                                           std::vector<Array> arrays);
  ~ArrayFileWriter();
  ArrayFileWriter(const ArrayFileWriter&) = delete;
  ArrayFileWriter& operator=(const ArrayFileWriter&) = delete;

  // Appends to the array `name`. Finish returns errors of the disk. Aborts if there is no array of this name and type.
  template <class T>
  void Append(const std::string& name, std::span<const T> values) {
    AppendBytes(name, ArrayData(std::vector<T>()).index(), values.data(), values.size_bytes());
  }

  // Syncs the file and renames it to its path. INTERNAL if an array does not have the announced number of values.
  Status Finish();

 private:
  struct Region;
  ArrayFileWriter() = default;
  void AppendBytes(const std::string& name, size_t type, const void* data, size_t size_bytes);
  void Write(uint64_t offset, const char* data, size_t size_bytes);
  void Fail(const Status& error);  // keeps the first

  std::string path_, temporary_;
  int fd_ = -1;
  ArrayFileHeader header_;
  std::vector<Region> regions_;
  std::mutex mutex_;
  Status status_;  // guarded by mutex_
  std::atomic<bool> failed_ = false;
};

}  // namespace tessera
