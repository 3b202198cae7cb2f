#include "common/classify/annotations.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "common/imaging/image_io.h"
#include "common/scene/photographs.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

constexpr uint8_t kNotAnnotated = 255;
constexpr int kColourTolerance = 16;    // per channel, for brushes that blend colours
constexpr double kBlendedShare = 0.05;  // largest accepted share of painted pixels with mixed colours
constexpr int kMinPixels = 20;          // a class with fewer annotated pixels is reported

using Colour = std::array<uint8_t, 3>;

std::string Hex(const Colour& c) { return absl::StrFormat("#%02x%02x%02x", c[0], c[1], c[2]); }

bool Near(const Colour& a, const Colour& b) {
  for (int k = 0; k < 3; ++k) {
    if (std::abs(a[k] - b[k]) > kColourTolerance) return false;
  }
  return true;
}

std::string Palette(const std::vector<SceneClass>& classes) {
  std::vector<std::string> entries;
  for (const SceneClass& c : classes) entries.push_back(absl::StrCat(c.name, " ", Hex(c.color_rgb)));
  return absl::StrJoin(entries, ", ");
}

std::string Numbers(const std::vector<SceneClass>& classes) {
  std::vector<std::string> entries;
  for (size_t c = 0; c < classes.size(); ++c) entries.push_back(absl::StrCat(c, " ", classes[c].name));
  return absl::StrJoin(entries, ", ");
}

StatusOr<LabelImage> FromNumbers(const std::string& path, const ByteImage& image,
                                 const std::vector<SceneClass>& classes) {
  for (size_t i = 0; i < image.plane_size(); ++i) {
    const uint8_t value = image.data[i];
    if (value == kNotAnnotated || value < classes.size()) continue;
    return InputError(
        path, absl::StrCat("pixel (", i % image.width, ", ", i / image.width, ")"), absl::StrCat("class ", value),
        absl::StrCat(Numbers(classes), ", or 255 where nothing is annotated (or an RGB PNG with colours)"));
  }
  LabelImage labels(image.width, image.height);
  labels.data = image.data;
  return labels;
}

StatusOr<LabelImage> FromColours(const std::string& path, const ByteImage& image,
                                 const std::vector<SceneClass>& classes, Warnings* warnings) {
  for (size_t a = 0; a < classes.size(); ++a) {
    for (size_t b = 0; b < a; ++b) {
      if (!Near(classes[a].color_rgb, classes[b].color_rgb)) continue;
      return InputError(
          path, "",
          absl::StrCat("colours, but classes ", classes[b].name, " and ", classes[a].name, " have the same colour"),
          "class ids in one channel, or a distinct \"color\" for each class in scene.json");
    }
  }
  LabelImage labels(image.width, image.height, 1, kNotAnnotated);
  std::map<Colour, int64_t> unknown;
  int64_t painted = 0, blended = 0;
  for (size_t i = 0; i < image.plane_size(); ++i) {
    if (image.channels == 4 && image.plane(3)[i] < 128) continue;
    const Colour colour = {image.plane(0)[i], image.plane(1)[i], image.plane(2)[i]};
    const auto it =
        std::find_if(classes.begin(), classes.end(), [&](const SceneClass& c) { return Near(colour, c.color_rgb); });
    if (it != classes.end()) {
      labels.data[i] = static_cast<uint8_t>(it - classes.begin());
      ++painted;
    } else if (!Near(colour, {255, 255, 255}) && !Near(colour, {0, 0, 0})) {
      ++painted;
      ++blended;
      if (unknown.size() < 100000 || unknown.contains(colour)) ++unknown[colour];
    }
  }
  if (blended == 0) return labels;
  const auto most = std::max_element(unknown.begin(), unknown.end(),
                                     [](const auto& a, const auto& b) { return a.second < b.second; });
  if (static_cast<double>(blended) > kBlendedShare * static_cast<double>(painted)) {
    return InputError(
        path, "",
        absl::StrCat(blended, " of ", painted, " painted pixels in unknown colours, mostly ", Hex(most->first)),
        absl::StrCat(Palette(classes),
                     "; white, black or transparent where nothing is annotated (export the painted "
                     "layer without the photograph)"));
  }
  warnings->push_back(absl::StrCat(path, ": ", blended, " pixels with mixed colours are ignored"));
  return labels;
}

// Sets the labels of masked pixels to kNotAnnotated.
Status IgnoreMasked(const SceneDescription& scene, const SceneView& view, LabelImage* labels) {
  if (!view.masked) return absl::OkStatus();
  LensModel as_stored;
  as_stored.pinhole = view.lens.pinhole;
  TESSERA_ASSIGN_OR_RETURN(const FloatImage luminance, ReadLuminance(absl::StrCat(scene.folder, "/", view.image_path),
                                                                     as_stored, OptionsOf(scene.folder, view)));
  for (size_t i = 0; i < labels->data.size(); ++i) {
    if (std::isnan(luminance.data[i])) labels->data[i] = kNotAnnotated;
  }
  return absl::OkStatus();
}

// The view of an annotation file, found by its name without extension.
std::optional<size_t> ViewOf(const std::string& stem, const std::map<std::string, size_t>& views) {
  auto it = views.find(stem);
  constexpr std::string_view kSuffix = "_label";
  if (it == views.end() && stem.ends_with(kSuffix)) it = views.find(stem.substr(0, stem.size() - kSuffix.size()));
  if (it == views.end()) it = views.find(fs::path(stem).replace_extension().generic_string());  // a.jpg.png
  return it == views.end() ? std::nullopt : std::optional<size_t>(it->second);
}

}  // namespace

int64_t Annotations::annotated() const { return std::accumulate(pixels.begin(), pixels.end(), int64_t{0}); }

StatusOr<Annotations> ReadAnnotations(const std::string& folder, const SceneDescription& scene, Warnings* warnings) {
  if (!fs::is_directory(folder)) {
    return InputError(folder, "", "no such folder",
                      "a folder of annotations: PNGs with the names of the scene's images");
  }
  TESSERA_ASSIGN_OR_RETURN(const std::vector<std::string> files, ListFiles(folder));
  std::map<std::string, size_t> views;
  const std::vector<std::string> stems = ViewStems(scene);
  for (size_t v = 0; v < stems.size(); ++v) views[stems[v]] = v;
  Annotations annotations;
  annotations.pixels.assign(scene.classes.size(), 0);
  Faults faults;
  std::map<size_t, std::string> taken;
  for (const std::string& file : files) {
    if (fs::path(file).extension() != ".png") continue;
    const std::string path = (fs::path(folder) / file).string();
    const std::optional<size_t> view = ViewOf(fs::path(file).replace_extension().generic_string(), views);
    if (!view) {
      faults.Add(
          InputError(path, "", "a name that matches no image of the scene",
                     absl::StrCat("a name such as ", fs::path(scene.views[0].name).replace_extension(".png").string(),
                                  " for image ", scene.views[0].name)));
      continue;
    }
    if (const auto [it, is_new] = taken.emplace(*view, path); !is_new) {
      faults.Add(InputError(path, "", absl::StrCat("a second annotation of the image of ", it->second),
                            absl::StrCat("one annotation of image ", scene.views[*view].name)));
      continue;
    }
    StatusOr<ByteImage> image = ReadPng(path);
    if (!image.ok()) {
      faults.Add(image.status());
      continue;
    }
    const PinholeCamera& camera = scene.views[*view].lens.pinhole;
    if (image->width != camera.width || image->height != camera.height) {
      faults.Add(InputError(path, "", absl::StrCat(image->width, " x ", image->height, " pixels"),
                            absl::StrCat(camera.width, " x ", camera.height, " (the size of its image)")));
      continue;
    }
    StatusOr<LabelImage> labels = image->channels == 1 ? FromNumbers(path, *image, scene.classes)
                                                       : FromColours(path, *image, scene.classes, warnings);
    if (!labels.ok()) {
      faults.Add(labels.status());
      continue;
    }
    const Status unmasked = IgnoreMasked(scene, scene.views[*view], &*labels);
    if (!unmasked.ok()) {
      faults.Add(unmasked);
      continue;
    }
    for (const uint8_t label : labels->data) {
      if (label != kNotAnnotated) ++annotations.pixels[label];
    }
    annotations.images.push_back({*view, path, *std::move(labels)});
  }
  TESSERA_RETURN_IF_ERROR(faults.ToStatus());
  std::sort(annotations.images.begin(), annotations.images.end(),
            [](const Annotation& a, const Annotation& b) { return a.view < b.view; });
  size_t present = 0;
  for (size_t c = 0; c < scene.classes.size(); ++c) {
    if (annotations.pixels[c] >= kMinPixels) {
      ++present;
    } else {
      warnings->push_back(absl::StrCat(folder, ": class ", scene.classes[c].name, " has ", annotations.pixels[c],
                                       " annotated pixels, too few to train it: annotate more of it"));
    }
  }
  if (present < 2) {
    return InputError(folder, "",
                      absl::StrCat(present, present == 1 ? " class" : " classes", " with at least ", kMinPixels,
                                   " annotated pixels in ", annotations.images.size(),
                                   annotations.images.size() == 1 ? " image" : " images"),
                      absl::StrCat("at least 2 of ", Palette(scene.classes)));
  }
  return annotations;
}

}  // namespace tessera
