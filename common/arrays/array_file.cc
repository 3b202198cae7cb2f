#include "common/arrays/array_file.h"

#include <bit>
#include <cstring>
#include <limits>

#include "common/storage/files.h"
#include "common/storage/hash.h"

namespace tessera {
namespace {

static_assert(std::endian::native == std::endian::little, "arrays are stored in native byte order");

constexpr char kMagic[8] = {'T', 'E', 'S', 'A', 'R', 'R', '\0', '\1'};
constexpr uint64_t kAlignment = 64;
constexpr size_t kFixedHeaderBytes = 32;
constexpr size_t kEntryBytes = 2 + 1 + 8 + 8 + 8;  // without the name
constexpr size_t kMaxNameBytes = 255;              // names are quoted in messages

uint64_t Aligned(uint64_t offset) { return (offset + kAlignment - 1) / kAlignment * kAlignment; }

std::pair<const void*, uint64_t> BytesOf(const ArrayData& data) {
  return std::visit(
      [](const auto& values) {
        return std::pair<const void*, uint64_t>(values.data(), values.size() * sizeof(values[0]));
      },
      data);
}

uint64_t CountOf(const ArrayData& data) {
  return std::visit([](const auto& values) { return static_cast<uint64_t>(values.size()); }, data);
}

template <class T>
void Append(std::string* out, T value) {
  out->append(reinterpret_cast<const char*>(&value), sizeof(value));
}

Status Damaged(const std::string& name, uint64_t offset, const std::string& found, const std::string& expected) {
  return absl::DataLossError(name + ": byte " + std::to_string(offset) + ": found " + found + ", expected " + expected);
}

// Reads consecutive values from `bytes`. Call Has() before Next().
class Cursor {
 public:
  explicit Cursor(std::string_view bytes) : bytes_(bytes) {}
  size_t offset() const { return offset_; }
  bool Has(uint64_t size) const { return size <= bytes_.size() - offset_; }
  template <class T>
  T Next() {
    T value;
    std::memcpy(&value, bytes_.data() + offset_, sizeof(T));
    offset_ += sizeof(T);
    return value;
  }
  std::string NextString(size_t size) {
    std::string text(bytes_.substr(offset_, size));
    offset_ += size;
    return text;
  }

 private:
  std::string_view bytes_;
  size_t offset_ = 0;
};

template <size_t kIndex = 0>
bool ReadValues(size_t type, const char* data, uint64_t size_bytes, ArrayData* out) {
  if constexpr (kIndex < std::variant_size_v<ArrayData>) {
    if (type != kIndex) return ReadValues<kIndex + 1>(type, data, size_bytes, out);
    auto& values = out->emplace<kIndex>();
    values.resize(size_bytes / sizeof(values[0]));
    if (size_bytes > 0) std::memcpy(values.data(), data, size_bytes);
    return true;
  } else {
    return false;
  }
}

constexpr uint64_t kValueBytes[] = {4, 8, 4, 4, 8, 1, 2};
static_assert(std::size(kValueBytes) == std::variant_size_v<ArrayData>);

}  // namespace

Status ArrayFile::Missing(const std::string& array) const {
  return absl::DataLossError(name + ": array \"" + array + "\" is missing");
}

Status ArrayFile::WrongType(const std::string& array) const {
  return absl::DataLossError(name + ": array \"" + array + "\": its value type differs from the expected one");
}

Status ArrayFile::WrongCount(const std::string& array, int64_t found, int64_t expected) const {
  return absl::DataLossError(name + ": array \"" + array + "\": found " + std::to_string(found) + " values, expected " +
                             std::to_string(expected));
}

uint64_t ArrayFileHeader::value_bytes(const Entry& entry) { return kValueBytes[entry.type]; }

uint64_t ArrayFileHeader::LayOut() {
  uint64_t offset = kFixedHeaderBytes + metadata.size() + 8;
  for (const Entry& entry : entries) offset += kEntryBytes + entry.name.size();
  for (Entry& entry : entries) {
    entry.offset = Aligned(offset);
    offset = entry.offset + entry.count * kValueBytes[entry.type];
  }
  return file_bytes = offset;
}

std::string ArrayFileHeader::Serialize() const {
  std::string out(kMagic, sizeof(kMagic));
  Append<uint64_t>(&out, file_bytes);
  Append<uint64_t>(&out, metadata.size());
  Append<uint64_t>(&out, entries.size());
  for (const Entry& entry : entries) {
    Append<uint16_t>(&out, static_cast<uint16_t>(entry.name.size()));
    out += entry.name;
    Append<uint8_t>(&out, static_cast<uint8_t>(entry.type));
    Append<uint64_t>(&out, entry.count);
    Append<uint64_t>(&out, entry.offset);
    Append<uint64_t>(&out, entry.hash);
  }
  out += metadata;
  Append<uint64_t>(&out, Xxh3(out.data(), out.size()));
  return out;
}

std::string SerializeArrayFile(const ArrayFile& file) {
  ArrayFileHeader header;
  header.metadata = file.metadata;
  for (const auto& [name, data] : file.arrays) {
    const auto [bytes, size] = BytesOf(data);
    header.entries.push_back({name, data.index(), CountOf(data), 0, Xxh3(bytes, size)});
  }
  const uint64_t total = header.LayOut();
  std::string out = header.Serialize();
  out.reserve(total);
  for (const auto& [name, data] : file.arrays) {
    const auto [bytes, size] = BytesOf(data);
    out.resize(Aligned(out.size()), '\0');
    if (size > 0) out.append(static_cast<const char*>(bytes), size);
  }
  return out;
}

StatusOr<ArrayFileHeader> ParseArrayFileHeader(std::string_view bytes, const std::string& name) {
  ArrayFileHeader header;
  Cursor cursor(bytes);
  if (!cursor.Has(kFixedHeaderBytes)) {
    return Damaged(name, 0, std::to_string(bytes.size()) + " bytes", "at least " + std::to_string(kFixedHeaderBytes));
  }
  const std::string magic = cursor.NextString(sizeof(kMagic));
  if (magic.compare(0, 7, kMagic, 7) != 0) return Damaged(name, 0, "no array file signature", "\"TESARR\"");
  if (magic[7] != kMagic[7]) {
    return Damaged(name, 7, "version " + std::to_string(static_cast<uint8_t>(magic[7])),
                   "version " + std::to_string(kMagic[7]));
  }
  const uint64_t total = header.file_bytes = cursor.Next<uint64_t>();
  if (total != bytes.size()) {
    return Damaged(name, 8, std::to_string(bytes.size()) + " bytes in the file", std::to_string(total));
  }
  const uint64_t metadata_bytes = cursor.Next<uint64_t>();
  const uint64_t array_count = cursor.Next<uint64_t>();
  std::vector<ArrayFileHeader::Entry>& entries = header.entries;
  for (uint64_t i = 0; i < array_count; ++i) {
    const size_t at = cursor.offset();
    if (!cursor.Has(kEntryBytes)) return Damaged(name, at, "the end of the file", "an array's entry");
    ArrayFileHeader::Entry entry;
    const size_t name_bytes = cursor.Next<uint16_t>();
    if (name_bytes > kMaxNameBytes) {
      return Damaged(name, at, "a name of " + std::to_string(name_bytes) + " bytes",
                     "at most " + std::to_string(kMaxNameBytes));
    }
    if (!cursor.Has(name_bytes + kEntryBytes - 2)) return Damaged(name, at, "the end of the file", "an array's entry");
    entry.name = cursor.NextString(name_bytes);
    entry.type = cursor.Next<uint8_t>();
    entry.count = cursor.Next<uint64_t>();
    entry.offset = cursor.Next<uint64_t>();
    entry.hash = cursor.Next<uint64_t>();
    if (entry.type >= std::size(kValueBytes)) {
      return Damaged(name, at, "value type " + std::to_string(entry.type),
                     "0 to " + std::to_string(std::size(kValueBytes) - 1));
    }
    if (!entries.empty() && entry.name <= entries.back().name) {
      return Damaged(name, at, "array \"" + entry.name + "\" after \"" + entries.back().name + "\"",
                     "names in ascending order");
    }
    entries.push_back(std::move(entry));
  }
  if (!cursor.Has(metadata_bytes) || bytes.size() - cursor.offset() - metadata_bytes < 8) {
    return Damaged(name, cursor.offset(), "the end of the file", std::to_string(metadata_bytes) + " bytes of metadata");
  }
  header.metadata = cursor.NextString(metadata_bytes);
  const uint64_t header_hash = Xxh3(bytes.data(), cursor.offset());
  const size_t hash_at = cursor.offset();
  if (cursor.Next<uint64_t>() != header_hash) return Damaged(name, hash_at, "a wrong checksum", "that of the header");

  uint64_t end = cursor.offset();
  for (const ArrayFileHeader::Entry& entry : entries) {
    const uint64_t begin = Aligned(end);
    if (entry.offset != begin) {
      return Damaged(name, end, "array \"" + entry.name + "\" at byte " + std::to_string(entry.offset),
                     "byte " + std::to_string(begin));
    }
    const uint64_t value_bytes = kValueBytes[entry.type];
    if (begin > bytes.size() || entry.count > (bytes.size() - begin) / value_bytes) {
      return Damaged(name, begin, "the end of the file",
                     std::to_string(entry.count) + " values of \"" + entry.name + "\"");
    }
    for (uint64_t i = end; i < begin; ++i) {
      if (bytes[i] != '\0') return Damaged(name, i, "a nonzero byte between arrays", "zero");
    }
    end = begin + entry.count * value_bytes;
  }
  if (end != bytes.size()) {
    return Damaged(name, end, std::to_string(bytes.size() - end) + " more bytes", "the end of the file");
  }
  return header;
}

StatusOr<ArrayFile> ParseArrayFile(const std::string& bytes, const std::string& name) {
  TESSERA_ASSIGN_OR_RETURN(ArrayFileHeader header, ParseArrayFileHeader(bytes, name));
  ArrayFile file;
  file.name = name;
  file.metadata = std::move(header.metadata);
  for (const ArrayFileHeader::Entry& entry : header.entries) {
    const uint64_t size = entry.count * kValueBytes[entry.type];
    if (Xxh3(bytes.data() + entry.offset, size) != entry.hash) {
      return Damaged(name, entry.offset, "a wrong checksum", "that of array \"" + entry.name + "\"");
    }
    ReadValues(entry.type, bytes.data() + entry.offset, size, &file.arrays[entry.name]);
  }
  return file;
}

Status WriteArrayFile(const std::string& path, const ArrayFile& file) {
  return WriteFileAtomic(path, SerializeArrayFile(file));
}

StatusOr<ArrayFile> ReadArrayFile(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, std::numeric_limits<int64_t>::max()));
  return ParseArrayFile(bytes, path);
}

}  // namespace tessera
