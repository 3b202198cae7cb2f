#include "common/blocks/photograph_files.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "common/base/printable.h"
#include "common/imaging/image_header.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kMaxEntries = 2'000'000;  // of a folder of images
constexpr std::array<const char*, 5> kImageExtensions = {".jpg", ".jpeg", ".png", ".tif", ".tiff"};

}  // namespace

StatusOr<PathReplacement> ParsePathReplacement(const std::string& text) {
  const size_t at = text.find('=');
  if (at == std::string::npos || at == 0 || at + 1 == text.size()) {
    return InputError("--image-path", "", absl::StrCat("'", text, "'"),
                      "OLD=NEW: the beginning of paths in the source, and the folder on this machine");
  }
  return PathReplacement{text.substr(0, at), text.substr(at + 1)};
}

std::string PlainPath(const std::string& path) {
  std::string plain = path;
  std::replace(plain.begin(), plain.end(), '\\', '/');
  if (absl::StartsWithIgnoreCase(plain, "file://")) plain.erase(0, 7);
  return plain;
}

std::vector<std::string> PathParts(const std::string& path) {
  std::vector<std::string> parts = absl::StrSplit(PlainPath(path), '/', absl::SkipEmpty());
  std::erase(parts, ".");
  return parts;
}

bool IsImageName(const std::string& name) {
  return std::any_of(kImageExtensions.begin(), kImageExtensions.end(),
                     [&](const char* extension) { return absl::EndsWithIgnoreCase(name, extension); });
}

std::string FolderOfSource(const std::string& source) {
  const std::string path = AbsolutePath(source);
  return fs::is_directory(path) ? path : fs::path(path).parent_path().string();
}

void ImageIndex::AddFolder(const std::string& folder, int64_t max_entries) {
  std::error_code error;
  fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied, error), end;
  for (int64_t entries = 0; !error && it != end && entries < max_entries; it.increment(error), ++entries) {
    const std::string name = it->path().filename().string();
    std::error_code ignored;
    if (it->is_directory(ignored) && fs::exists(it->path() / "import.json", ignored)) it.disable_recursion_pending();
    if (!IsImageName(name) || !it->is_regular_file(ignored)) continue;
    files_[absl::AsciiStrToLower(name)].push_back(it->path().string());
    by_stem_[absl::AsciiStrToLower(it->path().stem().string())].push_back(it->path().string());
  }
}

ImageIndex::Matches ImageIndex::Longest(const std::vector<std::string>& parts) const {
  Matches best;
  if (parts.empty()) return best;
  const bool is_label = !IsImageName(parts.back());
  const auto& files = is_label ? by_stem_ : files_;
  const auto found = files.find(absl::AsciiStrToLower(parts.back()));
  if (found == files.end()) return best;
  for (const std::string& file : found->second) {
    std::vector<std::string> own = PathParts(file);
    if (is_label) own.back() = fs::path(file).stem().string();
    size_t common = 0;
    while (common < parts.size() && common < own.size() &&
           absl::EqualsIgnoreCase(parts[parts.size() - 1 - common], own[own.size() - 1 - common])) {
      ++common;
    }
    if (common > best.common) best.files.clear();
    best.common = std::max(best.common, common);
    if (common == best.common) best.files.push_back(file);
  }
  std::sort(best.files.begin(), best.files.end());
  return best;
}

PhotographFiles::PhotographFiles(const std::string& source, PhotographSearch search)
    : source_folder_(FolderOfSource(source)), search_(std::move(search)) {}

StatusOr<std::string> PhotographFiles::Find(const std::string& path) {
  std::error_code ignored;
  std::string here = PathHere(path);
  if (fs::is_regular_file(here, ignored)) return here;
  if (!index_) {
    index_.emplace();
    for (const std::string& folder : search_.folders) index_->AddFolder(AbsolutePath(folder), kMaxEntries);
    if (search_.folders.empty()) index_->AddFolder(source_folder_, kMaxEntries);
  }
  const std::vector<std::string> files = index_->Longest(PathParts(path)).files;
  if (files.empty()) return absl::NotFoundError(absl::StrCat("no file of image '", Printable(path), "'"));
  if (files.size() > 1) {
    return absl::InvalidArgumentError(
        absl::StrCat("image '", Printable(path), "', which may be ", files[0], " or ", files[1],
                     files.size() > 2 ? absl::StrCat(" or ", files.size() - 2, " more") : ""));
  }
  return files[0];
}

StatusOr<ImageSize> PhotographFiles::SizeOf(const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(const std::string file, Find(path));
  TESSERA_ASSIGN_OR_RETURN(const ImageHeader header, ReadImageHeader(file));
  return header.size;
}

std::string PhotographFiles::PathHere(const std::string& path) const {
  const std::string plain = PlainPath(path);
  size_t longest = 0;
  std::string here = plain;
  for (const PathReplacement& replacement : search_.replacements) {
    std::string from = PlainPath(replacement.from);
    while (absl::EndsWith(from, "/") && from.size() > 1) from.pop_back();
    if (from.size() <= longest || !absl::StartsWithIgnoreCase(plain, from)) continue;
    const bool whole_names = plain.size() == from.size() || plain[from.size()] == '/' || from.back() == '/';
    if (!whole_names) continue;
    longest = from.size();
    here = absl::StrCat(replacement.to, "/", plain.substr(from.size()));
  }
  if (longest == 0 && !fs::path(here).is_absolute()) here = absl::StrCat(source_folder_, "/", here);
  return AbsolutePath(here);
}

}  // namespace tessera
