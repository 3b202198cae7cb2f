#include "common/imaging/file_bytes.h"

#include "common/storage/files.h"

namespace tessera {

namespace {

StatusOr<std::vector<uint8_t>> AsBytes(const std::string& path, const StatusOr<std::string>& bytes) {
  if (absl::IsNotFound(bytes.status())) return InputError(path, "", "no such file", "a readable file");
  if (!bytes.ok()) return bytes.status();
  return std::vector<uint8_t>(bytes->begin(), bytes->end());
}

}  // namespace

StatusOr<std::vector<uint8_t>> ReadFileBytes(const std::string& path) { return AsBytes(path, ReadFile(path)); }

StatusOr<std::vector<uint8_t>> ReadFileStart(const std::string& path, int64_t size_bytes) {
  return AsBytes(path, ReadFileRange(path, 0, size_bytes));
}

Status ReplaceFile(const std::string& path, const std::vector<uint8_t>& bytes) {
  return WriteFileAtomic(path, std::string(bytes.begin(), bytes.end()));
}

}  // namespace tessera
