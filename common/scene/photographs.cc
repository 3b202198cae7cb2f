#include "common/scene/photographs.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/base/parallel.h"
#include "common/imaging/undistort.h"

namespace tessera {
namespace {

constexpr int kFullRange = 65535;

std::string StemOf(const std::string& name) { return std::filesystem::path(name).replace_extension().generic_string(); }

// The smallest number of all bits set that is at least `highest`; kFullRange if that has more than 14 bits.
int WhiteLevelOf(int highest) {
  for (const int bits : {8, 10, 11, 12, 14}) {
    if (highest < 1 << bits) return (1 << bits) - 1;
  }
  return kFullRange;
}

// The factor of the image's size to its camera's, with rounding of the sides; 1 if the sides have different ones, and
// for images of which a margin of a few pixels was cut.
double FactorOf(const ImageSize& image, const PinholeCamera& camera) {
  const bool is_wide = camera.width >= camera.height;
  const double factor =
      is_wide ? static_cast<double>(image.width) / camera.width : static_cast<double>(image.height) / camera.height;
  return std::abs(factor - 1) > 0.02 && std::abs(image.width - factor * camera.width) <= 1 &&
                 std::abs(image.height - factor * camera.height) <= 1
             ? factor
             : 1;
}

bool HasSizeOf(const ImageSize& image, const PinholeCamera& camera) {
  return image.width == camera.width && image.height == camera.height;
}

// Whether `factor` times the size of the camera is the image's, within rounding.
bool IsScaledBy(double factor, const ImageSize& image, const PinholeCamera& camera) {
  return std::abs(image.width - factor * camera.width) <= 1.5 && std::abs(image.height - factor * camera.height) <= 1.5;
}

Status WrongSizeError(const std::string& path, const ImageSize& image, const PinholeCamera& camera) {
  std::string hint;
  if (image.width == camera.height && image.height == camera.width) {
    hint = ": it was turned; use the image as the camera stored it";
  } else if (const double factor = FactorOf(image, camera); factor != 1) {
    hint = absl::StrFormat(": it has %.4g times this size; scale all images by this factor, or none", factor);
  }
  return InputError(path, "", absl::StrCat(image.width, " x ", image.height, " pixels"),
                    absl::StrCat(camera.width, " x ", camera.height, " (the size of its camera)", hint));
}

}  // namespace

PhotographOptions OptionsOf(const std::string& folder, const SceneView& view) {
  PhotographOptions options;
  if (!view.mask_path.empty()) options.mask_path = absl::StrCat(folder, "/", view.mask_path);
  options.white_level = view.white_level;
  return options;
}

std::vector<std::string> FindMaskFiles(const SceneDescription& scene, const std::vector<std::string>& files,
                                       const std::string& folder, Warnings* warnings, Faults* faults) {
  const std::vector<std::string> stems = ViewStems(scene);
  std::vector<std::string> found(scene.views.size());
  std::set<std::string> used;
  int64_t with_mask = 0;
  for (size_t v = 0; v < scene.views.size(); ++v) {
    const std::string& name = scene.views[v].name;
    const std::string stem = StemOf(name);
    const bool is_shared = stems[v] != stem;
    std::set<std::string> masks;
    for (const std::string& file : {name + ".png", stem + ".mask.png", stem + ".png"}) {
      if (!std::binary_search(files.begin(), files.end(), file)) continue;
      used.insert(file);
      masks.insert(file);
      if (is_shared && file != name + ".png") {
        faults->Add(InputError(absl::StrCat(scene.folder, "/", folder, "/", file), "",
                               absl::StrCat("one name for the masks of several images such as '", name, "'"),
                               absl::StrCat("'", name, ".png' for the mask of this image")));
      }
    }
    if (masks.empty()) continue;
    ++with_mask;
    found[v] = *masks.begin();
    if (masks.size() == 1) continue;
    faults->Add(InputError(absl::StrCat(scene.folder, "/", folder, "/", *std::next(masks.begin())), "",
                           absl::StrCat("a second mask of image '", name, "', beside '", *masks.begin(), "'"),
                           "one mask for each image: delete the other"));
  }
  const auto unused = std::find_if(files.begin(), files.end(), [&](const auto& file) { return !used.contains(file); });
  if (warnings != nullptr && unused != files.end()) {
    warnings->push_back(absl::StrCat(folder, ": ", files.size() - used.size(), " files belong to no image, such as '",
                                     *unused, "': the mask of 'a.jpg' is 'a.jpg.png', 'a.mask.png' or 'a.png'"));
  }
  if (warnings != nullptr && with_mask > 0 && with_mask < static_cast<int64_t>(found.size())) {
    warnings->push_back(absl::StrCat(folder, ": ", with_mask, " of ", found.size(), " images have a mask"));
  }
  return found;
}

std::vector<Status> FitLenses(const std::vector<std::optional<ImageHeader>>& headers, const std::string& folder,
                              SceneDescription* scene, Warnings* warnings) {
  std::vector<Status> statuses(headers.size());
  double factor = 0;
  bool is_copy = false;
  int64_t turned = 0, known = 0;
  size_t first_turned = 0, first_known = 0;
  for (size_t v = 0; v < headers.size(); ++v) {
    if (!headers[v]) continue;
    if (headers[v]->orientation != 1 && turned++ == 0) first_turned = v;
    const PinholeCamera& camera = scene->views[v].lens.pinhole;
    if (known++ == 0) {
      first_known = v;
      factor = FactorOf(headers[v]->size, camera);
      is_copy = factor != 1;
    }
    is_copy = is_copy && IsScaledBy(factor, headers[v]->size, camera);
  }
  const auto warn = [&](const std::string& text) {
    if (warnings != nullptr) warnings->push_back(absl::StrCat(folder, ": ", text));
  };
  if (is_copy) {
    const PinholeCamera& camera = scene->views[first_known].lens.pinhole;
    const ImageSize& size = headers[first_known]->size;
    warn(absl::StrFormat(
        "all images have %.4g times the size of their cameras, such as '%s' with %d x %d instead of %d x %d pixels: "
        "the intrinsics are scaled",
        factor, scene->views[first_known].name, size.width, size.height, camera.width, camera.height));
    for (size_t v = 0; v < headers.size(); ++v) {
      SceneView& view = scene->views[v];
      const PinholeCamera& full = view.lens.pinhole;
      view.lens.pinhole = headers[v] ? full.Resized(headers[v]->size.width, headers[v]->size.height)
                                     : full.Resized(static_cast<int>(std::lround(factor * full.width)),
                                                    static_cast<int>(std::lround(factor * full.height)));
      view.camera.intrinsics = view.lens.pinhole;
    }
  }
  if (turned > 0) {
    warn(absl::StrCat(turned, turned == 1 ? " image has" : " images have", " a tag of orientation, such as '",
                      scene->views[first_turned].name,
                      "': pixels are used as stored, not turned, because poses are for the stored pixels"));
  }
  for (size_t v = 0; v < headers.size(); ++v) {
    const SceneView& view = scene->views[v];
    if (!headers[v] || HasSizeOf(headers[v]->size, view.lens.pinhole)) continue;
    statuses[v] =
        WrongSizeError(absl::StrCat(scene->folder, "/", folder, "/", view.name), headers[v]->size, view.lens.pinhole);
  }
  return statuses;
}

Status ChooseWhiteLevels(const std::vector<uint8_t>& is_read, const TaskControl& control, SceneDescription* scene,
                         Warnings* warnings, const std::map<std::string, int>& known) {
  std::map<int, std::vector<size_t>> flights;
  for (size_t v = 0; v < scene->views.size(); ++v) flights[scene->views[v].flight].push_back(v);
  for (const auto& entry : flights) {
    const std::vector<size_t>& views = entry.second;
    int level = 0;
    for (const size_t v : views) level = is_read[v] ? level : std::max(level, scene->views[v].white_level);
    std::vector<size_t> wide;  // views with 16-bit images
    int highest = 0;
    // A few at a time, since the first image of the full range ends the search.
    constexpr size_t kBatch = 16;
    for (size_t first = 0; first < views.size() && level < kFullRange; first += kBatch) {
      TESSERA_RETURN_IF_ERROR(control.Check());
      std::vector<int> samples(std::min(kBatch, views.size() - first), 0);
      ParallelForEach(samples.size(), 1, [&](size_t i) {
        const SceneView& view = scene->views[views[first + i]];
        if (!is_read[views[first + i]] || view.image_path.empty()) return;
        const auto found = known.find(view.image_path);
        samples[i] = found != known.end()
                         ? found->second
                         : HighestSample(absl::StrCat(scene->folder, "/", view.image_path)).value_or(0);
      });
      for (size_t i = 0; i < samples.size(); ++i) {
        if (samples[i] > 0) wide.push_back(views[first + i]);
        highest = std::max(highest, samples[i]);
      }
      if (!wide.empty()) level = std::max(level, WhiteLevelOf(highest));
    }
    if (wide.empty() || level == kFullRange) continue;
    for (const size_t v : wide) scene->views[v].white_level = level;
    if (warnings != nullptr) {
      warnings->push_back(absl::StrCat("images of ", wide.size(), " views, such as '", scene->views[wide.front()].name,
                                       "', have 16 bits, but no sample above ", highest, ": ", level,
                                       " is taken as white"));
    }
  }
  return absl::OkStatus();
}

}  // namespace tessera
