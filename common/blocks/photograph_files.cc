#include "common/blocks/photograph_files.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "common/imaging/image_header.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

std::vector<std::string> BlockPathParts(std::string path) {
  std::replace(path.begin(), path.end(), '\\', '/');
  return absl::StrSplit(path, '/', absl::SkipEmpty());
}

// How many parts at their ends are equal.
size_t CommonPathTail(const std::vector<std::string>& a, const std::vector<std::string>& b) {
  size_t n = 0;
  while (n < a.size() && n < b.size() && a[a.size() - 1 - n] == b[b.size() - 1 - n]) ++n;
  return n;
}

}  // namespace

StatusOr<std::string> PhotographFiles::Find(const std::string& path) {
  const std::vector<std::string> parts = BlockPathParts(path);
  if (parts.empty()) return absl::NotFoundError("no file name");
  const std::string slashes = absl::StrCat(path[0] == '/' || path[0] == '\\' ? "/" : "", absl::StrJoin(parts, "/"));
  if (slashes[0] == '/' && FileExists(slashes)) return slashes;
  if (slashes[0] != '/' && FileExists(absl::StrCat(folder_, "/", slashes))) return absl::StrCat(folder_, "/", slashes);
  if (!images_folder_.empty()) {
    StatusOr<std::string> found = SearchImagesFolder(parts);
    if (found.ok() || !absl::IsNotFound(found.status())) return found;
  }
  for (size_t first = 0; first < parts.size(); ++first) {
    const StatusOr<std::string> file =
        JoinInside(folder_, absl::StrJoin(parts.begin() + static_cast<int64_t>(first), parts.end(), "/"));
    if (file.ok() && FileExists(*file)) return *file;
  }
  return absl::NotFoundError(absl::StrCat("no file ", path));
}

StatusOr<std::string> PhotographFiles::SearchImagesFolder(const std::vector<std::string>& parts) {
  if (!images_.has_value()) {
    TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> files, ListFiles(images_folder_));
    images_.emplace();
    for (const std::string& file : files) images_->emplace(BlockPathParts(file).back(), file);
  }
  const auto [begin, end] = images_->equal_range(parts.back());
  size_t most = 0;
  std::vector<std::string> best;
  for (auto it = begin; it != end; ++it) {
    const size_t tail = CommonPathTail(parts, BlockPathParts(it->second));
    if (tail > most) best.clear();
    if (tail >= most) best.push_back(it->second);
    most = std::max(most, tail);
  }
  if (best.empty()) return absl::NotFoundError(absl::StrCat("no file ", parts.back(), " in ", images_folder_));
  if (best.size() > 1) {
    return absl::InvalidArgumentError(
        absl::StrCat(best.size(), " files of this name in ", images_folder_, ": ", best[0], ", ", best[1]));
  }
  return absl::StrCat(images_folder_, "/", best[0]);
}

StatusOr<ImageSize> PhotographFiles::SizeOf(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::string file, Find(path));
  TESSERA_ASSIGN_OR_RETURN(const ImageHeader header, ReadImageHeader(file));
  return header.size;
}

}  // namespace tessera
