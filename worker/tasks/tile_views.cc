#include "worker/tasks/tile_views.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/imaging/image_io.h"
#include "common/tile/mapped_arrays.h"
#include "worker/refine/texels.h"

namespace tessera {
namespace {

using nlohmann::json;

// A view as it lies in the file.
struct Crop {
  int view = 0;
  PixelRect rect;
  PixelMapping mapping;
  int likelihood_width = 0, likelihood_height = 0, classes = 0;  // zeros: none
  std::vector<uint16_t> luminance;                               // codes of Texels::luminance
  std::vector<uint8_t> likelihoods;                              // a plane a class

  size_t pixels() const { return static_cast<size_t>(rect.width()) * rect.height(); }
  size_t likelihood_values() const { return static_cast<size_t>(likelihood_width) * likelihood_height * classes; }
};

std::string ArrayName(size_t crop, const char* what) { return absl::StrFormat("%06d.%s", crop, what); }

ImagePart PartOf(const PixelRect& rect) { return {rect.x0, rect.y0, rect.x1, rect.y1}; }

Status CropLikelihoods(const std::string& path, const SceneView& view, int classes, Crop* out) {
  TESSERA_ASSIGN_OR_RETURN(const LikelihoodPart part, ReadLikelihoodPart(path, classes, view.lens, PartOf(out->rect)));
  const PinholeCamera& whole = view.camera.intrinsics;
  out->mapping.scale_x = static_cast<double>(part.whole_width) / whole.width;
  out->mapping.scale_y = static_cast<double>(part.whole_height) / whole.height;
  out->mapping.first_x = part.x0;
  out->mapping.first_y = part.y0;
  out->likelihood_width = part.pixels.width;
  out->likelihood_height = part.pixels.height;
  out->classes = part.pixels.channels;
  out->likelihoods.reserve(part.pixels.data.size());
  for (const float value : part.pixels.data) {
    out->likelihoods.push_back(static_cast<uint8_t>(std::clamp(value, 0.0f, 1.0f) * Texels::kLikelihoodSteps + 0.5f));
  }
  return absl::OkStatus();
}

json ToJson(const Crop& crop) {
  return {{"view", crop.view},
          {"rect", {crop.rect.x0, crop.rect.y0, crop.rect.x1, crop.rect.y1}},
          {"likelihoods", {crop.likelihood_width, crop.likelihood_height, crop.classes}},
          {"mapping", {crop.mapping.scale_x, crop.mapping.scale_y, crop.mapping.first_x, crop.mapping.first_y}}};
}

Crop ParseCrop(const json& j) {
  Crop crop;
  crop.view = j.at("view");
  crop.rect = {j.at("rect").at(0), j.at("rect").at(1), j.at("rect").at(2), j.at("rect").at(3)};
  crop.likelihood_width = j.at("likelihoods").at(0);
  crop.likelihood_height = j.at("likelihoods").at(1);
  crop.classes = j.at("likelihoods").at(2);
  const json& mapping = j.at("mapping");
  crop.mapping.scale_x = mapping.at(0);
  crop.mapping.scale_y = mapping.at(1);
  crop.mapping.first_x = mapping.at(2);
  crop.mapping.first_y = mapping.at(3);
  return crop;
}

// One crop of a file that all of them share.
class FilePixels : public ViewPixels {
 public:
  FilePixels(std::shared_ptr<const MappedArrays> file, size_t index, Crop crop)
      : file_(std::move(file)), index_(index), crop_(std::move(crop)) {}
  int width() const override { return crop_.rect.width(); }
  int height() const override { return crop_.rect.height(); }
  StatusOr<FloatImage> Luminance() const override {
    const std::string name = ArrayName(index_, "luminance");
    TESSERA_ASSIGN_OR_RETURN(const auto codes, file_->Verified<uint16_t>(name, static_cast<int64_t>(crop_.pixels())));
    FloatImage image(width(), height());
    std::transform(codes.begin(), codes.end(), image.data.begin(), [](uint16_t code) {
      return code == 0 ? std::nanf("") : static_cast<float>(code - 1) / Texels::kLuminanceSteps;
    });
    file_->Release(name);
    return image;
  }
  bool has_likelihoods() const override { return crop_.classes > 0; }
  StatusOr<FloatImage> Likelihoods() const override {
    const std::string name = ArrayName(index_, "likelihoods");
    TESSERA_ASSIGN_OR_RETURN(const auto steps,
                             file_->Verified<uint8_t>(name, static_cast<int64_t>(crop_.likelihood_values())));
    FloatImage image(crop_.likelihood_width, crop_.likelihood_height, crop_.classes);
    std::transform(steps.begin(), steps.end(), image.data.begin(),
                   [](uint8_t step) { return static_cast<float>(step) / Texels::kLikelihoodSteps; });
    file_->Release(name);
    return image;
  }

 private:
  std::shared_ptr<const MappedArrays> file_;
  size_t index_;
  Crop crop_;
};

}  // namespace

Status CropTileViews(const TilePackage& package, const std::string& scene_folder, const std::string& path,
                     const TaskControl& control) {
  std::vector<Crop> crops;
  for (size_t v = 0; v < package.views.size(); ++v) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(0.9 * static_cast<double>(v) / static_cast<double>(package.views.size()), "reading images");
    const SceneView& view = package.views[v];
    Crop crop;
    crop.view = static_cast<int>(v);
    crop.rect = package.view_rects[v];
    if (crop.rect.empty()) continue;
    {
      TESSERA_ASSIGN_OR_RETURN(const FloatImage luminance,
                               ReadLuminancePart(scene_folder + "/" + view.image_path, view.lens, PartOf(crop.rect)));
      crop.luminance.reserve(luminance.data.size());
      for (const float value : luminance.data) crop.luminance.push_back(LuminanceCode(value));
    }
    if (package.has_likelihoods && !view.likelihood_path.empty()) {
      TESSERA_RETURN_IF_ERROR(CropLikelihoods(scene_folder + "/" + view.likelihood_path, view,
                                              static_cast<int>(package.classes.size()), &crop));
    }
    crops.push_back(std::move(crop));
  }
  control.Report(0.9, "writing crops");
  json metadata = {{"tile", package.tile}, {"crops", json::array()}};
  std::vector<ArrayFileWriter::Array> arrays;
  for (size_t i = 0; i < crops.size(); ++i) {
    metadata["crops"].push_back(ToJson(crops[i]));
    if (crops[i].classes > 0) {
      arrays.push_back({ArrayName(i, "likelihoods"), std::vector<uint8_t>(), crops[i].likelihoods.size()});
    }
    arrays.push_back({ArrayName(i, "luminance"), std::vector<uint16_t>(), crops[i].luminance.size()});
  }
  TESSERA_ASSIGN_OR_RETURN(const auto file, ArrayFileWriter::Create(path, metadata.dump(), std::move(arrays)));
  for (size_t i = 0; i < crops.size(); ++i) {
    if (crops[i].classes > 0) {
      file->Append(ArrayName(i, "likelihoods"), std::span<const uint8_t>(crops[i].likelihoods));
    }
    file->Append(ArrayName(i, "luminance"), std::span<const uint16_t>(crops[i].luminance));
  }
  return file->Finish();
}

StatusOr<std::vector<TileView>> OpenTileViews(const TilePackage& package, const std::string& path) {
  TESSERA_ASSIGN_OR_RETURN(MappedArrays opened, MappedArrays::Open(path));
  const auto file = std::make_shared<const MappedArrays>(std::move(opened));
  std::vector<TileView> views;
  try {
    const json metadata = json::parse(file->metadata());
    if (metadata.at("tile") != package.tile) {
      return absl::DataLossError(absl::StrCat(path, ": found crops of tile ", metadata.at("tile").get<int>(),
                                              ", expected those of tile ", package.tile));
    }
    for (const json& j : metadata.at("crops")) {
      Crop crop = ParseCrop(j);
      if (crop.view < 0 || static_cast<size_t>(crop.view) >= package.views.size() || crop.rect.empty()) {
        return absl::DataLossError(absl::StrCat(path, ": crop ", views.size(), ": found view ", crop.view,
                                                ", expected one of ", package.views.size()));
      }
      TileView view;
      view.view = crop.view;
      view.window = {package.views[crop.view].camera, crop.rect};
      view.mapping = crop.mapping;
      view.pixels = std::make_shared<FilePixels>(file, views.size(), std::move(crop));
      views.push_back(std::move(view));
    }
  } catch (const json::exception& e) {
    return absl::DataLossError(path + ": not the metadata of crops: " + e.what());
  }
  return views;
}

TileData MakeTileData(const TilePackage& package, const std::vector<TileView>& views, bool knows_labels) {
  TileData data;
  std::vector<int> loaded(package.views.size(), -1);
  for (size_t v = 0; v < views.size(); ++v) {
    loaded[views[v].view] = static_cast<int>(v);
    const PixelRect& rect = views[v].window.rect;
    const auto& [near_m, far_m] = package.view_depths[views[v].view];
    data.views.push_back({views[v].window.camera,
                          views[v].pixels,
                          knows_labels,
                          views[v].mapping,
                          rect.x0,
                          rect.y0,
                          {static_cast<float>(near_m), static_cast<float>(far_m)},
                          package.view_ids[views[v].view]});
  }
  for (const auto& [reference, other] : package.pairs) {
    if (loaded[reference] >= 0 && loaded[other] >= 0) data.pairs.push_back({loaded[reference], loaded[other]});
  }
  for (size_t c = 0; c < package.cell_at.size(); ++c) {
    data.groups.group_of_face.insert(data.groups.group_of_face.end(),
                                     package.cells.face_begin[c + 1] - package.cells.face_begin[c],
                                     static_cast<uint32_t>(c));
    const std::vector<int32_t>& looking = package.cell_views[c];
    std::vector<uint8_t> looks;
    for (const TileView& view : views) looks.push_back(std::binary_search(looking.begin(), looking.end(), view.view));
    data.groups.looks.push_back(std::move(looks));
  }
  return data;
}

}  // namespace tessera
