// The container format of all intermediate files: named typed arrays and a JSON string.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/status.h"

namespace tessera {

using ArrayData = std::variant<std::vector<float>, std::vector<double>, std::vector<int32_t>, std::vector<uint32_t>,
                               std::vector<int64_t>, std::vector<uint8_t>, std::vector<uint16_t>>;

// The content of an array file. Equal contents serialize to equal bytes.
struct ArrayFile {
  std::string name = "array file";  // its path, for error messages; not stored
  std::string metadata = "{}";      // canonical JSON
  std::map<std::string, ArrayData> arrays;

  // Removes the array `array` and returns it. DATA_LOSS if it is missing, has another type, or does not have `count`
  // values (-1: any number).
  template <class T>
  StatusOr<std::vector<T>> Take(const std::string& array, int64_t count = -1) {
    const auto it = arrays.find(array);
    if (it == arrays.end()) return Missing(array);
    auto* values = std::get_if<std::vector<T>>(&it->second);
    if (values == nullptr) return WrongType(array);
    if (count >= 0 && static_cast<int64_t>(values->size()) != count) {
      return WrongCount(array, static_cast<int64_t>(values->size()), count);
    }
    std::vector<T> taken = std::move(*values);
    arrays.erase(it);
    return taken;
  }

 private:
  Status Missing(const std::string& array) const;
  Status WrongType(const std::string& array) const;
  Status WrongCount(const std::string& array, int64_t found, int64_t expected) const;
};

// Layout (little-endian): "TESARR" 0 VERSION; u64 file size; u64 metadata size; u64 array count; then for each array,
// by name: u16 name size, name, u8 type, u64 count, u64 offset, u64 XXH3 of its bytes; then the metadata; u64 XXH3 of
// all bytes before it; then the arrays, each at a multiple of 64 bytes, with zeros between. Names have at most 255
// bytes.
std::string SerializeArrayFile(const ArrayFile& file);

// Accepts only the exact bytes that SerializeArrayFile writes; else DATA_LOSS with the byte offset, what was found and
// what was expected. `name`: the file's path, for messages.
StatusOr<ArrayFile> ParseArrayFile(const std::string& bytes, const std::string& name);

// The header of an array file: everything before the arrays' bytes.
struct ArrayFileHeader {
  struct Entry {
    std::string name;
    size_t type = 0;  // index of ArrayData's alternatives
    uint64_t count = 0, offset = 0, hash = 0;
  };
  std::string metadata = "{}";
  std::vector<Entry> entries;  // by name
  uint64_t file_bytes = 0;

  static uint64_t value_bytes(const Entry& entry);
  uint64_t LayOut();              // computes all offsets and file_bytes; returns file_bytes
  std::string Serialize() const;  // call LayOut first
};

// Reads and checks the header and the padding, not the arrays' bytes. Errors as in ParseArrayFile.
StatusOr<ArrayFileHeader> ParseArrayFileHeader(std::string_view bytes, const std::string& name);

// Writes a temporary file, syncs it and renames it to `path`.
Status WriteArrayFile(const std::string& path, const ArrayFile& file);
StatusOr<ArrayFile> ReadArrayFile(const std::string& path);

}  // namespace tessera
