#include "common/scene/image_files.h"

#include <algorithm>
#include <map>
#include <string_view>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "common/base/parallel.h"
#include "common/base/printable.h"

namespace tessera {
namespace {

constexpr size_t kMaxNames = 20;

constexpr std::string_view kPixelEndings[] = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".npy"};

std::string WithoutFolders(const std::string& name) { return name.substr(name.rfind('/') + 1); }

// Removes one of the endings from `lower`. False if it has none.
bool RemovePixelEnding(std::string* lower) {
  for (const std::string_view ending : kPixelEndings) {
    if (!lower->ends_with(ending)) continue;
    lower->resize(lower->size() - ending.size());
    return true;
  }
  return false;
}

}  // namespace

std::string PlainImageName(const std::string& name) {
  const std::string slashes = absl::StrReplaceAll(name, {{"\\", "/"}});
  std::vector<std::string> parts = absl::StrSplit(slashes, '/', absl::SkipEmpty());
  std::erase(parts, ".");
  return absl::StrCat(slashes.starts_with("/") ? "/" : "", absl::StrJoin(parts, "/"));
}

bool IsPixelFile(const std::string& path) {
  std::string lower = absl::AsciiStrToLower(path);
  return RemovePixelEnding(&lower);
}

std::string PixelStem(const std::string& path) {
  std::string stem = absl::AsciiStrToLower(WithoutFolders(path));
  while (RemovePixelEnding(&stem)) {
    if (stem.ends_with(".mask")) stem.resize(stem.size() - 5);
  }
  return stem;
}

ImageFiles FindImageFiles(const std::vector<std::string>& names, const std::function<bool(const std::string&)>& exists,
                          const std::function<std::vector<std::string>()>& list) {
  ImageFiles found;
  found.files.resize(names.size());
  found.hints.resize(names.size());
  ParallelForEach(names.size(), 16, [&](size_t i) {
    const std::string plain = PlainImageName(names[i]);
    if (exists(names[i])) {
      found.files[i] = names[i];
    } else if (plain != names[i] && exists(plain)) {
      found.files[i] = plain;
    }
  });
  if (std::none_of(found.files.begin(), found.files.end(), [](const std::string& file) { return file.empty(); })) {
    return found;
  }
  std::map<std::string, std::vector<std::string>> by_name, by_last_part;  // in lower case
  for (const std::string& file : list()) {
    by_name[absl::AsciiStrToLower(file)].push_back(file);
    by_last_part[absl::AsciiStrToLower(WithoutFolders(file))].push_back(file);
  }
  for (size_t i = 0; i < names.size(); ++i) {
    if (!found.files[i].empty()) continue;
    const std::string lower = absl::AsciiStrToLower(PlainImageName(names[i]));
    if (const auto same = by_name.find(lower); same != by_name.end()) {
      if (same->second.size() == 1) {
        found.files[i] = same->second.front();
        if (found.other_case++ == 0) {
          found.other_case_name = names[i];
          found.other_case_file = found.files[i];
        }
      } else {
        found.hints[i] = absl::StrCat("'", same->second[0], "' and '", same->second[1], "' differ from '", names[i],
                                      "' in upper and lower case");
      }
    } else if (const auto last = by_last_part.find(WithoutFolders(lower)); last != by_last_part.end()) {
      found.hints[i] = absl::StrCat("the images folder has '", last->second.front(), "' for '", names[i], "'");
    } else if (!IsUtf8(names[i])) {
      found.hints[i] = "names are not in UTF-8: save images.txt in that encoding";
    }
  }
  return found;
}

Status MissingImagesError(const std::string& path, const std::vector<std::string>& missing,
                          const std::vector<std::string>& hints, size_t images) {
  const auto hint = std::find_if(hints.begin(), hints.end(), [](const std::string& text) { return !text.empty(); });
  const std::string advice = absl::StrCat(
      hint == hints.end() ? "" : absl::StrCat(" (", *hint, ")"),
      ": copy the missing files, set 'images' in scene.json to their folder, or remove the images from the model");
  if (missing.size() == 1) {
    return InputError(absl::StrCat(path, "/", missing.front()), "", "no such file",
                      absl::StrCat("image '", missing.front(), "' of the COLMAP model", advice));
  }
  const size_t shown = std::min(missing.size(), kMaxNames);
  const std::string more = missing.size() > shown ? absl::StrCat(" and ", missing.size() - shown, " more") : "";
  return InputError(
      path, "",
      absl::StrCat("no files of ", missing.size(), " of the ", images, " images: ",
                   absl::StrJoin(missing.begin(), missing.begin() + static_cast<std::ptrdiff_t>(shown), ", "), more),
      absl::StrCat("a file for each image of the COLMAP model", advice));
}

}  // namespace tessera
