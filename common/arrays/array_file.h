// One container for every intermediate file: named typed arrays and a JSON string.
#ifndef TESSERA_COMMON_ARRAYS_ARRAY_FILE_H_
#define TESSERA_COMMON_ARRAYS_ARRAY_FILE_H_

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

// A plain value; equal values are equal bytes on disk.
struct ArrayFile {
  std::string name = "array file";  // the path it came from, for messages; not stored
  std::string metadata = "{}";      // canonical JSON
  std::map<std::string, ArrayData> arrays;

  // Moves the array `array` out. DATA_LOSS if it is missing, of another type, or has not `count` values (pass -1 to
  // take any number).
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
// everything so far; then the arrays' bytes, each at a multiple of 64 with zeros between. Names have 255 bytes at most.
std::string SerializeArrayFile(const ArrayFile& file);

// Strict: anything but what SerializeArrayFile writes is DATA_LOSS with the byte offset, what was found and what was
// expected. `name` stands for the file in messages.
StatusOr<ArrayFile> ParseArrayFile(const std::string& bytes, const std::string& name);

// Where the arrays of a file lie: what stands before their bytes.
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
  uint64_t LayOut();              // fills offsets and file_bytes, and gives the latter
  std::string Serialize() const;  // after LayOut
};

// Reads and checks all but the arrays' own bytes. Errors as ParseArrayFile's.
StatusOr<ArrayFileHeader> ParseArrayFileHeader(std::string_view bytes, const std::string& name);

// Through a temporary name, synced and renamed.
Status WriteArrayFile(const std::string& path, const ArrayFile& file);
StatusOr<ArrayFile> ReadArrayFile(const std::string& path);

}  // namespace tessera

#endif  // TESSERA_COMMON_ARRAYS_ARRAY_FILE_H_
