#include "server/http/stored_zip.h"

#include <algorithm>
#include <string_view>
#include <vector>

namespace tessera {
namespace {

// APPNOTE.TXT of PKWARE, sections 4.3.12 and 4.3.16.
constexpr std::string_view kEndSignature("PK\x05\x06", 4), kEntrySignature("PK\x01\x02", 4);
constexpr int64_t kEndBytes = 22, kEntryBytes = 46, kLocalBytes = 30, kMaxComment = 0xffff;
constexpr int64_t kMaxDirectoryBytes = 16 << 20, kMaxMembers = 100'000;
constexpr unsigned kEncrypted = 1, kSizesFollow = 8, kStored = 0;

unsigned Number(std::string_view bytes, int64_t at, int size) {
  unsigned number = 0;
  for (int i = size; i-- > 0;) number = number << 8 | static_cast<unsigned char>(bytes[static_cast<size_t>(at + i)]);
  return number;
}

Status Malformed() { return absl::DataLossError("malformed archive of a sheet"); }

struct Entry {
  std::string name;
  int64_t header = 0, size = 0;
};

}  // namespace

StatusOr<ZipDirectory> ReadZipDirectory(
    int64_t archive_bytes, const std::function<StatusOr<std::string>(int64_t offset_bytes, int64_t size_bytes)>& read) {
  const int64_t tail_bytes = std::min(archive_bytes, kEndBytes + kMaxComment);
  if (tail_bytes < kEndBytes) return Malformed();
  TESSERA_ASSIGN_OR_RETURN(const std::string tail, read(archive_bytes - tail_bytes, tail_bytes));
  const size_t end = tail.rfind(kEndSignature, tail.size() - static_cast<size_t>(kEndBytes));
  if (end == std::string::npos || static_cast<int64_t>(tail.size()) != tail_bytes) return Malformed();
  const auto at = static_cast<int64_t>(end);
  const int64_t members = Number(tail, at + 10, 2), directory_bytes = Number(tail, at + 12, 4),
                directory_at = Number(tail, at + 16, 4), end_at = archive_bytes - tail_bytes + at;
  if (members > kMaxMembers || directory_bytes > kMaxDirectoryBytes || directory_at + directory_bytes > end_at) {
    return Malformed();
  }
  TESSERA_ASSIGN_OR_RETURN(const std::string directory, read(directory_at, directory_bytes));
  if (static_cast<int64_t>(directory.size()) != directory_bytes) return Malformed();
  std::vector<Entry> entries;
  int64_t place = 0;
  for (int64_t i = 0; i < members; ++i) {
    if (place + kEntryBytes > directory_bytes ||
        std::string_view(directory).substr(static_cast<size_t>(place), 4) != kEntrySignature) {
      return Malformed();
    }
    const unsigned flags = Number(directory, place + 8, 2), method = Number(directory, place + 10, 2),
                   packed = Number(directory, place + 20, 4), size = Number(directory, place + 24, 4);
    const int64_t name = Number(directory, place + 28, 2), extra = Number(directory, place + 30, 2),
                  comment = Number(directory, place + 32, 2);
    if (method != kStored || (flags & (kEncrypted | kSizesFollow)) != 0 || packed != size ||
        place + kEntryBytes + name > directory_bytes) {
      return Malformed();
    }
    entries.push_back({directory.substr(static_cast<size_t>(place + kEntryBytes), static_cast<size_t>(name)),
                       Number(directory, place + 42, 4), size});
    place += kEntryBytes + name + extra + comment;
  }
  // A member's content ends where the next member's local header begins. That header's size, which the directory does
  // not have, need not be read.
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.header < b.header; });
  ZipDirectory found;
  for (size_t i = 0; i < entries.size(); ++i) {
    const Entry& entry = entries[i];
    const int64_t content_end = i + 1 < entries.size() ? entries[i + 1].header : directory_at;
    const int64_t offset = content_end - entry.size;
    if (offset < entry.header + kLocalBytes + static_cast<int64_t>(entry.name.size())) return Malformed();
    if (!found.emplace(entry.name, ZipMember{offset, entry.size}).second) return Malformed();
  }
  return found;
}

}  // namespace tessera
