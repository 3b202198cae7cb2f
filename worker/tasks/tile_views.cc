#include "worker/tasks/tile_views.h"

#include <algorithm>

#include "common/imaging/image_io.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

constexpr int kMargin_px = 32;     // the mesh moves, and windows reach beyond it
constexpr int kAlignment_px = 16;  // so that pixels of all pyramid levels are those of the whole image

FloatImage Crop(const FloatImage& image, const PixelRect& rect) {
  FloatImage part(rect.width(), rect.height(), image.channels);
  for (int c = 0; c < image.channels; ++c) {
    for (int y = 0; y < rect.height(); ++y) {
      const float* row = image.plane(c) + static_cast<size_t>(rect.y0 + y) * image.width + rect.x0;
      std::copy(row, row + rect.width(), &part.at(0, y, c));
    }
  }
  return part;
}

Status LoadLikelihoods(const std::string& path, const SceneView& view, int classes, const PixelRect& rect,
                       TileView* out) {
  TESSERA_ASSIGN_OR_RETURN(FloatImage likelihoods, ReadLikelihoods(path, classes, view.lens));
  const PinholeCamera& whole = view.camera.intrinsics;
  if (likelihoods.width == whole.width && likelihoods.height == whole.height) {
    out->likelihoods = Crop(likelihoods, rect);
    out->mapping.offset_x = -rect.x0;
    out->mapping.offset_y = -rect.y0;
    return absl::OkStatus();
  }
  out->mapping.scale_x = static_cast<double>(likelihoods.width) / whole.width;
  out->mapping.scale_y = static_cast<double>(likelihoods.height) / whole.height;
  out->likelihoods = std::move(likelihoods);
  return absl::OkStatus();
}

}  // namespace

StatusOr<std::vector<TileView>> LoadTileViews(const TilePackage& package, const std::string& scene_folder,
                                              const TaskControl& control) {
  std::vector<TileView> views;
  for (size_t v = 0; v < package.views.size(); ++v) {
    TESSERA_RETURN_IF_ERROR(control.Check());
    control.Report(static_cast<double>(v) / package.views.size(), "reading images");
    const SceneView& view = package.views[v];
    const PixelRect rect = ProjectedBounds(package.mesh, view.camera, kMargin_px, kAlignment_px);
    if (rect.empty()) continue;
    TileView loaded;
    loaded.view = static_cast<int>(v);
    loaded.window = {view.camera, rect};
    TESSERA_ASSIGN_OR_RETURN(const FloatImage luminance,
                             ReadLuminance(scene_folder + "/" + view.image_path, view.lens));
    loaded.luminance = Crop(luminance, rect);
    if (package.has_likelihoods && !view.likelihood_path.empty()) {
      TESSERA_RETURN_IF_ERROR(LoadLikelihoods(scene_folder + "/" + view.likelihood_path, view,
                                              static_cast<int>(package.classes.size()), rect, &loaded));
    }
    views.push_back(std::move(loaded));
  }
  return views;
}

}  // namespace tessera
