#include "worker/refine/data_term.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/base/parallel.h"
#include "common/imaging/pyramid.h"

namespace tessera {
namespace {

// The part of the photograph that is at hand, its corners on pixel edges of `level`; in pixels of level 0.
PixelRect ViewWindow(const RefineView& view, int level) {
  const int align = 1 << level, step = PhotoView::kWindowStep * align;
  const PinholeCamera& k = view.camera.intrinsics;
  const auto up = [align](int x, int size) { return std::min((x + align - 1) / align, size / align) * align; };
  return {view.x0 / step * step, view.y0 / step * step, up(view.x0 + view.pixels->width(), k.width),
          up(view.y0 + view.pixels->height(), k.height)};
}

StatusOr<PhotoView> MakePhotoView(const RefineView& view, int level, bool semantic) {
  const PixelRect rect = ViewWindow(view, level);
  PhotoView out;
  out.camera = PyramidCamera(view.camera, level);
  // Pixels count from the middle of the whole image, where floats hold them best; from an even one (Texels).
  PinholeCamera& k = out.camera.intrinsics;
  const int middle_x = k.width / 4 * 2, middle_y = k.height / 4 * 2;
  k.cx -= middle_x;
  k.cy -= middle_y;
  out.depths = view.depths;
  FloatImage image(rect.width(), rect.height());
  {
    TESSERA_ASSIGN_OR_RETURN(const FloatImage luminance, view.pixels->Luminance());
    for (int y = 0; y < rect.height(); ++y) {
      for (int x = 0; x < rect.width(); ++x) {
        const int sx = rect.x0 + x - view.x0, sy = rect.y0 + y - view.y0;
        const bool inside = sx >= 0 && sy >= 0 && sx < luminance.width && sy < luminance.height;
        image.at(x, y) = inside ? luminance.at(sx, sy) : std::nanf("");
      }
    }
  }
  for (int i = 0; i < level; ++i) image = HalfResolution(image);
  const int x0 = (rect.x0 >> level) - middle_x, y0 = (rect.y0 >> level) - middle_y;
  if (!semantic || !view.asks_likelihoods || !view.pixels->has_likelihoods()) {
    out.texels = MakeTexels(image, x0, y0);
  } else {
    TESSERA_ASSIGN_OR_RETURN(const FloatImage likelihoods, view.pixels->Likelihoods());
    PixelMapping mapping = view.mapping;
    mapping.scale_x *= 1 << level;
    mapping.scale_y *= 1 << level;
    mapping.offset_x += mapping.scale_x * middle_x;
    mapping.offset_y += mapping.scale_y * middle_y;
    out.texels = MakeTexels(image, likelihoods, mapping, x0, y0);
  }
  return out;
}

}  // namespace

PhotoOptions MakePhotoOptions(const DataOptions& options) {
  PhotoOptions out;
  out.window = MakeWindow(options.window_px, options.gaussian_window);
  out.window.min_valid = static_cast<float>(options.min_valid);
  out.window.min_variance = static_cast<float>(options.min_sigma * options.min_sigma);
  out.window.max_mean_difference = static_cast<float>(options.max_mean_difference);
  out.window.max_variance_ratio = static_cast<float>(options.max_variance_ratio);
  out.window.epsilon = 1e-6f;
  out.window.noise_variance = static_cast<float>(options.noise_sigma * options.noise_sigma);
  out.min_cosine = options.min_cosine;
  out.window.outlier = static_cast<float>(options.photo_outlier);
  out.semantic.weight = static_cast<float>(options.semantic);
  out.occlusion_px = options.occlusion_px;
  return out;
}

int ReferenceMargin_px(int window_px, int level) { return (2 * (window_px / 2) + 1) << level; }

int TargetMargin_px(int level) { return 2 << level; }

DataTerm::DataTerm(const std::vector<RefineView>& views, const std::vector<ViewPair>& pairs, const ViewGroups& groups,
                   const MeshCells* cells, const DataOptions& options)
    : problem_views_(views), pairs_(pairs), groups_(groups), cells_(cells), options_(options) {}

Status DataTerm::EnterLevel(int level, const std::string& scratch_folder) {
  if (level == level_) return absl::OkStatus();
  const bool semantic = options_.semantic > 0 || options_.contour > 0;
  level_ = -1;
  photo_.reset();
  views_.assign(problem_views_.size(), PhotoView());
  photo_ = std::make_unique<PhotoTerm>(&views_, pairs_, MakePhotoOptions(options_), &groups_);
  std::vector<Status> read(views_.size());
  ParallelFor(static_cast<int64_t>(views_.size()), 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      StatusOr<PhotoView> view = MakePhotoView(problem_views_[i], level, semantic);
      read[i] = view.status();
      if (!view.ok()) continue;
      views_[i] = *std::move(view);
      if (!scratch_folder.empty()) read[i] = photo_->SpillTexels(i, scratch_folder);
    }
  });
  for (const Status& status : read) TESSERA_RETURN_IF_ERROR(status);
  level_ = level;
  return absl::OkStatus();
}

void DataTerm::Evaluate(const TriangleMesh& mesh, const std::vector<uint8_t>& own, const Clock* clock,
                        FaceDerivatives* out) {
  ContourOptions contour;
  contour.weight = options_.contour;
  std::vector<std::vector<FaceContour>> contours(views_.size());
  const auto find = [&](size_t index, const PhotoView& view, const FaceMap& map) {
    contours[index] = FindContours(mesh, mesh.labels, own, view, map, contour);
  };
  const bool has_contours = options_.contour > 0 && !mesh.labels.empty();
  photo_->Evaluate(mesh, own, cells_, clock, &out->photo, has_contours ? PhotoTerm::MapVisitor(find) : nullptr);
  std::vector<int32_t> ids;
  for (const RefineView& view : problem_views_) ids.push_back(view.id);
  out->contours = AddContours(contours, ids);
}

}  // namespace tessera
