#include "common/imaging/file_bytes.h"

#include "absl/strings/str_cat.h"
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

StatusOr<std::vector<uint8_t>> Interleaved(const ByteImage& image) {
  if (image.empty() || (image.channels != 1 && image.channels != 3)) {
    return absl::InvalidArgumentError(absl::StrCat("cannot encode an image of ", image.width, " x ", image.height,
                                                   " pixels and ", image.channels, " channels"));
  }
  std::vector<uint8_t> samples(image.data.size());
  for (int c = 0; c < image.channels; ++c) {
    const uint8_t* plane = image.plane(c);
    for (size_t i = 0; i < image.plane_size(); ++i) samples[i * image.channels + c] = plane[i];
  }
  return samples;
}

}  // namespace tessera
