#include "common/imaging/likelihood_form.h"

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <set>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/parallel.h"
#include "common/imaging/file_bytes.h"
#include "common/imaging/label_file.h"
#include "common/imaging/npy.h"

namespace tessera {
namespace {

// Ids count from one if 0 has at most this share of the pixels: more is a class of its own.
constexpr double kMostUnlabelled = 0.05;
constexpr size_t kMaxColors = 1000;  // of a file; pictures have more

StatusOr<StoredLabels> ReadStoredLabels(const std::string& path, int classes) {
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> head, ReadFileStart(path, 1 << 16));
  const auto starts_with = [&](const char* text, size_t size) {
    return head.size() >= size && std::memcmp(head.data(), text, size) == 0;
  };
  if (starts_with("\x89PNG", 4)) return ReadLabelPng(path);
  StoredLabels labels;
  if (!starts_with("\x93NUMPY", 6)) return labels;
  std::error_code error;
  const size_t size = std::filesystem::file_size(path, error);
  if (error) return labels;
  TESSERA_ASSIGN_OR_RETURN(NpyArray array, FindNpyArray(head, path, size));
  if (!IsIdArray(array, classes)) return labels;
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> bytes, ReadFileBytes(path));
  TESSERA_ASSIGN_OR_RETURN(array, FindNpyArray(bytes, path));
  labels.values = NpyIds(array.channels == 1 ? array : ChannelsLast(array));
  return labels;
}

LabelContent ContentOf(const StoredLabels& labels, const std::set<uint32_t>& class_colors) {
  LabelContent content;
  if (labels.values.empty()) return content;
  content.kind = labels.is_color          ? LabelContent::Kind::kColors
                 : labels.palette.empty() ? LabelContent::Kind::kIds
                                          : LabelContent::Kind::kPalette;
  std::set<uint32_t> values;
  uint32_t last = StoredLabels::kNone;
  for (const uint32_t value : labels.values.data) {
    if (value != last && value != StoredLabels::kNone && values.size() < kMaxColors) values.insert(value);
    last = value;
    const uint32_t id = IdOf(labels, value);
    content.zeros += id == 0;
    content.pixels += id != StoredLabels::kNone && id != 255;
  }
  content.has_class_colors = content.has_ids = true;
  bool any_class = false;
  for (const uint32_t value : values) {
    const uint32_t id = IdOf(labels, value), color = ColorOf(labels, value);
    const bool is_class = class_colors.contains(color);
    any_class |= is_class;
    content.has_class_colors &= is_class || color == 0;
    content.has_ids &= id != StoredLabels::kNoId;
    if (id != 255) content.highest_id = std::max(content.highest_id, static_cast<int64_t>(id));
  }
  content.has_class_colors &= any_class;
  return content;
}

std::set<uint32_t> ColorValues(const std::vector<std::array<uint8_t, 3>>& colors) {
  std::set<uint32_t> values;
  for (const auto& color : colors) values.insert(ColorValue(color));
  return values;
}

}  // namespace

LabelContent ReadLabelContent(const std::string& path, const std::vector<std::array<uint8_t, 3>>& colors) {
  const StatusOr<StoredLabels> labels = ReadStoredLabels(path, static_cast<int>(colors.size()));
  return labels.ok() ? ContentOf(*labels, ColorValues(colors)) : LabelContent();
}

LikelihoodForm FindLikelihoodForm(const std::vector<std::string>& paths,
                                  const std::vector<std::array<uint8_t, 3>>& colors, const LikelihoodForm& given,
                                  Warnings* warnings) {
  std::vector<LabelContent> contents(paths.size());
  ParallelForEach(static_cast<int64_t>(paths.size()), 1,
                  [&](int64_t i) { contents[i] = ReadLabelContent(paths[i], colors); });
  return CompleteLikelihoodForm(paths, contents, colors, given, warnings);
}

LikelihoodForm CompleteLikelihoodForm(const std::vector<std::string>& paths, const std::vector<LabelContent>& contents,
                                      const std::vector<std::array<uint8_t, 3>>& colors, const LikelihoodForm& given,
                                      Warnings* warnings) {
  const int classes = static_cast<int>(colors.size());
  const bool are_distinct = ColorValues(colors).size() == colors.size();
  LikelihoodForm form = given;
  const auto warn = [&](const std::string& text) { warnings->push_back(text); };
  const auto is_colored = [](const LabelContent& content) {
    return content.kind == LabelContent::Kind::kColors || content.kind == LabelContent::Kind::kPalette;
  };
  // Colours decide if those of all files are classes', or if they cannot be ids.
  const int64_t colored = std::count_if(contents.begin(), contents.end(), is_colored);
  const bool have_class_colors = std::all_of(contents.begin(), contents.end(), [&](const LabelContent& content) {
    return !is_colored(content) || content.has_class_colors;
  });
  const bool have_ids = std::all_of(contents.begin(), contents.end(), [&](const LabelContent& content) {
    return !is_colored(content) || content.has_ids;
  });
  if (colored > 0 && are_distinct && (have_class_colors || !have_ids)) form.colors = colors;
  const auto first_of = [&](const auto& is_one) {
    const auto found = std::find_if(contents.begin(), contents.end(), is_one);
    return std::filesystem::path(paths[found - contents.begin()]).filename().string();
  };
  if (colored > 0) {
    warn(absl::StrCat("likelihoods: ", colored, " label images with colours, such as '", first_of(is_colored),
                      form.colors.empty() ? "': the indices of their palettes or their grey levels are the class ids"
                                          : "': the colours of the classes in scene.json decide"));
  }
  LabelContent all;
  const auto has_ids = [&](const LabelContent& content) {
    return content.kind != LabelContent::Kind::kNoLabels && (form.colors.empty() || !is_colored(content));
  };
  for (const LabelContent& content : contents) {
    if (!has_ids(content)) continue;
    all.highest_id = std::max(all.highest_id, content.highest_id);
    all.zeros += content.zeros;
    all.pixels += content.pixels;
  }
  if (given.first_id || all.pixels == 0) return form;
  const double share = static_cast<double>(all.zeros) / static_cast<double>(all.pixels);
  if (all.highest_id == classes && share <= kMostUnlabelled) {
    form.first_id = 1;
    warn(
        absl::StrFormat("likelihoods: class ids of label images count from 1, since the highest of %d classes is %d; "
                        "0, at %.1f %% of the pixels, is unknown",
                        classes, classes, 100 * share));
  } else if (all.zeros == 0 && all.highest_id < classes) {
    warn(
        "likelihoods: no label image has class id 0; if ids count from 1, set \"likelihood_first_id\": 1 in "
        "scene.json");
  }
  return form;
}

}  // namespace tessera
