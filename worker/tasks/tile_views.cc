#include "worker/tasks/tile_views.h"

#include <utility>

#include "common/imaging/image_io.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

constexpr int kMargin_px = 32;     // the mesh moves, and windows reach beyond it
constexpr int kAlignment_px = 16;  // so that pixels of all pyramid levels are those of the whole image

ImagePart PartOf(const PixelRect& rect) { return {rect.x0, rect.y0, rect.x1, rect.y1}; }

Status LoadLikelihoods(const std::string& path, const SceneView& view, int classes, const PixelRect& rect,
                       TileView* out) {
  TESSERA_ASSIGN_OR_RETURN(LikelihoodPart part, ReadLikelihoodPart(path, classes, view.lens, PartOf(rect)));
  const PinholeCamera& whole = view.camera.intrinsics;
  out->mapping.scale_x = static_cast<double>(part.whole_width) / whole.width;
  out->mapping.scale_y = static_cast<double>(part.whole_height) / whole.height;
  out->mapping.offset_x = -part.x0;
  out->mapping.offset_y = -part.y0;
  out->likelihoods = std::move(part.pixels);
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
    TESSERA_ASSIGN_OR_RETURN(loaded.luminance,
                             ReadLuminancePart(scene_folder + "/" + view.image_path, view.lens, PartOf(rect)));
    if (package.has_likelihoods && !view.likelihood_path.empty()) {
      TESSERA_RETURN_IF_ERROR(LoadLikelihoods(scene_folder + "/" + view.likelihood_path, view,
                                              static_cast<int>(package.classes.size()), rect, &loaded));
    }
    views.push_back(std::move(loaded));
  }
  return views;
}

}  // namespace tessera
