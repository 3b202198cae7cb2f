#include "common/importing/image_paths.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kMaxEntries = 2'000'000;  // of a folder of images
constexpr int64_t kMaxEntriesOfHint = 100'000;
constexpr std::array<const char*, 5> kImageExtensions = {".jpg", ".jpeg", ".png", ".tif", ".tiff"};

// The path with '/' between folders, without "file://".
std::string PlainPath(const std::string& path) {
  std::string plain = path;
  std::replace(plain.begin(), plain.end(), '\\', '/');
  if (absl::StartsWithIgnoreCase(plain, "file://")) plain.erase(0, 7);
  return plain;
}

std::vector<std::string> PartsOf(const std::string& path) {
  std::vector<std::string> parts = absl::StrSplit(PlainPath(path), '/', absl::SkipEmpty());
  std::erase(parts, ".");
  return parts;
}

// Programs may name photographs by labels, which are names without extension.
bool IsImageName(const std::string& name) {
  return std::any_of(kImageExtensions.begin(), kImageExtensions.end(),
                     [&](const char* extension) { return absl::EndsWithIgnoreCase(name, extension); });
}

// Files of images in folders, by the lower case of their last name.
class ImageIndex {
 public:
  // Continues with what can be read.
  void AddFolder(const std::string& folder, int64_t max_entries) {
    std::error_code error;
    fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied, error), end;
    for (int64_t entries = 0; !error && it != end && entries < max_entries; it.increment(error), ++entries) {
      const std::string name = it->path().filename().string();
      std::error_code ignored;
      // Another import's scene has the same images.
      if (it->is_directory(ignored) && fs::exists(it->path() / "import.json", ignored)) it.disable_recursion_pending();
      if (!IsImageName(name) || !it->is_regular_file(ignored)) continue;
      files_[absl::AsciiStrToLower(name)].push_back(it->path().string());
      by_stem_[absl::AsciiStrToLower(it->path().stem().string())].push_back(it->path().string());
    }
  }
  // The files whose paths have the longest common end with `parts`, and its length; none if no last name is equal. A
  // last part without an image's extension stands for one with any.
  std::pair<std::vector<std::string>, size_t> Longest(const std::vector<std::string>& parts) const {
    std::vector<std::string> best;
    size_t longest = 0;
    if (parts.empty()) return {best, longest};
    const bool is_label = !IsImageName(parts.back());
    const auto& files = is_label ? by_stem_ : files_;
    const auto found = files.find(absl::AsciiStrToLower(parts.back()));
    if (found == files.end()) return {best, longest};
    for (const std::string& file : found->second) {
      std::vector<std::string> own = PartsOf(file);
      if (is_label) own.back() = fs::path(file).stem().string();
      size_t common = 0;
      while (common < parts.size() && common < own.size() &&
             absl::EqualsIgnoreCase(parts[parts.size() - 1 - common], own[own.size() - 1 - common])) {
        ++common;
      }
      if (common > longest) best.clear();
      longest = std::max(longest, common);
      if (common == longest) best.push_back(file);
    }
    std::sort(best.begin(), best.end());
    return {best, longest};
  }

 private:
  std::map<std::string, std::vector<std::string>> files_, by_stem_;
};

std::string FolderOfSource(const std::string& source) {
  const std::string path = AbsolutePath(source);
  return fs::is_directory(path) ? path : fs::path(path).parent_path().string();
}

// Where the image's path leads on this machine: after the longest replacement that fits; relative to the source.
std::string PathHere(const std::string& path, const ImageSearch& search) {
  const std::string plain = PlainPath(path);
  size_t longest = 0;
  std::string here = plain;
  for (const PathReplacement& replacement : search.replacements) {
    std::string from = PlainPath(replacement.from);
    while (absl::EndsWith(from, "/") && from.size() > 1) from.pop_back();
    if (from.size() <= longest || !absl::StartsWithIgnoreCase(plain, from)) continue;
    const bool whole_names = plain.size() == from.size() || plain[from.size()] == '/' || from.back() == '/';
    if (!whole_names) continue;
    longest = from.size();
    here = absl::StrCat(replacement.to, "/", plain.substr(from.size()));
  }
  if (longest == 0 && !fs::path(here).is_absolute()) here = absl::StrCat(FolderOfSource(search.source), "/", here);
  return AbsolutePath(here);
}

// The last fault: which option would find most of the missing images, from files near those that were searched.
Status MissingImages(const std::vector<const BlockImage*>& missing, size_t images, const ImageSearch& search) {
  ImageIndex near;
  std::set<std::string> parents;
  for (const std::string& folder : search.folders)
    parents.insert(fs::path(AbsolutePath(folder)).parent_path().string());
  if (search.folders.empty()) parents.insert(fs::path(FolderOfSource(search.source)).parent_path().string());
  for (const std::string& parent : parents) {
    if (fs::path(parent).has_relative_path()) near.AddFolder(parent, kMaxEntriesOfHint);  // not the root
  }
  std::map<std::pair<std::string, std::string>, int64_t> votes;
  for (const BlockImage* image : missing) {
    const std::vector<std::string> parts = PartsOf(image->path);
    const auto [files, common] = near.Longest(parts);
    if (files.size() != 1) continue;
    const std::vector<std::string> own = PartsOf(files[0]);
    const std::string root = absl::StartsWith(PlainPath(image->path), "/") ? "/" : "";
    ++votes[{absl::StrCat(root, absl::StrJoin(parts.begin(), parts.end() - common, "/")),
             absl::StrCat("/", absl::StrJoin(own.begin(), own.end() - common, "/"))}];
  }
  std::string advice = "add --images with the folder where they lie";
  const auto most =
      std::max_element(votes.begin(), votes.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  if (most != votes.end()) {
    const auto& [from, to] = most->first;
    advice = from.empty() ? absl::StrCat("--images '", to, "' finds ", most->second)
                          : absl::StrCat("--image-path '", from, "'='", to, "' finds ", most->second);
  }
  return InputError(search.source, "", absl::StrCat("no file for ", missing.size(), " of ", images, " images"),
                    absl::StrCat("all of them: ", advice));
}

// Gives each image the shortest end of its path that no other image has, ignoring case.
void NameImages(const std::vector<BlockImage>& images, std::vector<FoundImage>* found) {
  std::vector<std::vector<std::string>> parts;
  std::vector<size_t> used(images.size(), 1);
  for (const BlockImage& image : images) {
    parts.push_back(PartsOf(image.path));
    // No name may leave the folder, and a drive is no folder.
    std::erase_if(parts.back(), [](const std::string& part) { return part == ".." || absl::EndsWith(part, ":"); });
  }
  const auto name = [&](size_t i) {
    const size_t count = std::min(used[i], parts[i].size());
    return absl::StrJoin(parts[i].end() - count, parts[i].end(), "/");
  };
  for (bool changed = true; changed;) {
    changed = false;
    std::map<std::string, std::vector<size_t>> same;
    for (size_t i = 0; i < images.size(); ++i) {
      if (!(*found)[i].file.empty()) same[absl::AsciiStrToLower(name(i))].push_back(i);
    }
    for (const auto& [text, members] : same) {
      if (members.size() < 2) continue;
      for (const size_t i : members) {
        if (used[i] >= parts[i].size()) continue;
        ++used[i];
        changed = true;
      }
    }
  }
  for (size_t i = 0; i < images.size(); ++i) {
    FoundImage& image = (*found)[i];
    image.name = name(i);
    if (!IsImageName(image.name)) image.name += fs::path(image.file).extension().string();
  }
}

}  // namespace

StatusOr<PathReplacement> ParsePathReplacement(const std::string& text) {
  const size_t at = text.find('=');
  if (at == std::string::npos || at == 0 || at + 1 == text.size()) {
    return InputError("--image-path", "", absl::StrCat("'", text, "'"),
                      "OLD=NEW: the beginning of paths in the source, and the folder on this machine");
  }
  return PathReplacement{text.substr(0, at), text.substr(at + 1)};
}

std::vector<FoundImage> FindImages(const std::vector<BlockImage>& images, const ImageSearch& search, Faults* faults) {
  std::vector<FoundImage> found(images.size());
  std::vector<const BlockImage*> missing;
  std::map<std::string, size_t> owners;
  ImageIndex index;
  bool indexed = false;
  for (size_t i = 0; i < images.size(); ++i) {
    const BlockImage& image = images[i];
    if (!image.oriented) continue;
    std::string file = PathHere(image.path, search);
    std::error_code ignored;
    if (!fs::is_regular_file(file, ignored)) {
      file.clear();
      if (!indexed) {
        for (const std::string& folder : search.folders) index.AddFolder(AbsolutePath(folder), kMaxEntries);
        if (search.folders.empty()) index.AddFolder(FolderOfSource(search.source), kMaxEntries);
        indexed = true;
      }
      const auto [files, common] = index.Longest(PartsOf(image.path));
      if (files.size() > 1) {
        faults->Add(InputError(search.source, image.location,
                               absl::StrCat("image '", image.path, "', which may be ", files[0], " or ", files[1],
                                            files.size() > 2 ? absl::StrCat(" or ", files.size() - 2, " more") : ""),
                               "one file: state its folder by --image-path OLD=NEW"));
        continue;
      }
      if (files.size() == 1) file = files[0];
    }
    if (file.empty()) {
      missing.push_back(&image);
      faults->Add(InputError(search.source, image.location, absl::StrCat("no file of image '", image.path, "'"),
                             "an image file"));
      continue;
    }
    const auto [owner, is_new] = owners.emplace(file, i);
    if (!is_new) {
      faults->Add(
          InputError(search.source, image.location,
                     absl::StrCat("file ", file, " for '", images[owner->second].path, "' and '", image.path, "'"),
                     "a file for each image"));
      continue;
    }
    found[i].file = file;
  }
  if (!missing.empty()) faults->Add(MissingImages(missing, images.size(), search));
  NameImages(images, &found);
  return found;
}

}  // namespace tessera
