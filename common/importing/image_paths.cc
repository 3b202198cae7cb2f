#include "common/importing/image_paths.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kMaxEntriesOfHint = 100'000;

// The last fault: which option would find most of the missing images, from files near those that were searched.
Status MissingImages(const std::vector<std::string>& missing, size_t images, const std::string& source,
                     const PhotographSearch& search) {
  ImageIndex near;
  std::set<std::string> parents;
  for (const std::string& folder : search.folders)
    parents.insert(fs::path(AbsolutePath(folder)).parent_path().string());
  if (search.folders.empty()) parents.insert(fs::path(FolderOfSource(source)).parent_path().string());
  for (const std::string& parent : parents) {
    if (fs::path(parent).has_relative_path()) near.AddFolder(parent, kMaxEntriesOfHint);  // not the root
  }
  std::map<std::pair<std::string, std::string>, int64_t> votes;
  for (const std::string& path : missing) {
    const std::vector<std::string> parts = PathParts(path);
    const auto [files, common] = near.Longest(parts);
    if (files.size() != 1) continue;
    const std::vector<std::string> own = PathParts(files[0]);
    const std::string to = absl::StrCat("/", absl::StrJoin(own.begin(), own.end() - common, "/"));
    const std::string root = absl::StartsWith(PlainPath(path), "/") ? "/" : "";
    // A replaced path must name a file, which a label does not.
    const std::string from = absl::StrCat(root, absl::StrJoin(parts.begin(), parts.end() - common, "/"));
    ++votes[{IsImageName(parts.back()) ? from : "", to}];
  }
  std::string advice = "add --images with the folder where they lie";
  const auto most =
      std::max_element(votes.begin(), votes.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  if (most != votes.end()) {
    const auto& [from, to] = most->first;
    advice = from.empty() ? absl::StrCat("--images '", to, "' finds ", most->second)
                          : absl::StrCat("--image-path '", from, "'='", to, "' finds ", most->second);
  }
  return InputError(source, "", absl::StrCat("no file for ", missing.size(), " of ", images, " images"),
                    absl::StrCat("all of them: ", advice));
}

// Gives each image the shortest end of its path that no other image has, ignoring case.
void NameImages(const std::vector<BlockImage>& images, std::vector<FoundImage>* found) {
  std::vector<std::vector<std::string>> parts;
  std::vector<size_t> used(images.size(), 1);
  for (const BlockImage& image : images) {
    parts.push_back(PathParts(image.path));
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

std::vector<FoundImage> FindImages(const ImportedBlock& block, const std::string& source,
                                   const PhotographSearch& search, Faults* faults) {
  const std::vector<BlockImage>& images = block.images;
  std::vector<FoundImage> found(images.size());
  std::vector<std::string> missing = block.missing_images;
  std::map<std::string, size_t> owners;
  PhotographFiles files(source, search);
  for (size_t i = 0; i < images.size(); ++i) {
    const BlockImage& image = images[i];
    if (!image.oriented) continue;
    const StatusOr<std::string> file = files.Find(image.path);
    if (!file.ok()) {
      const bool is_missing = absl::IsNotFound(file.status());
      if (is_missing) missing.push_back(image.path);
      faults->Add(InputError(source, image.location, std::string(file.status().message()),
                             is_missing ? "an image file" : "one file: state its folder by --image-path OLD=NEW"));
      continue;
    }
    const auto [owner, is_new] = owners.emplace(*file, i);
    if (!is_new) {
      faults->Add(
          InputError(source, image.location,
                     absl::StrCat("file ", *file, " for '", images[owner->second].path, "' and '", image.path, "'"),
                     "a file for each image"));
      continue;
    }
    found[i].file = *file;
  }
  if (!missing.empty()) {
    faults->Add(MissingImages(missing, images.size() + block.missing_images.size(), source, search));
  }
  NameImages(images, &found);
  return found;
}

}  // namespace tessera
