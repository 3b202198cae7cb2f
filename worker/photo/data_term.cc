#include "worker/photo/data_term.h"

#include <algorithm>
#include <utility>

#include "common/base/parallel.h"
#include "worker/photo/contour_profile.h"
#include "worker/visibility/image_window.h"

namespace tessera {
namespace {

StatusOr<PhotoView> MakePhotoView(const RefineView& view, int level, bool with_likelihoods) {
  PhotoView out;
  out.camera = PyramidCamera(view.camera, level);
  // Move the pixel origin to the middle of the whole image, where floats are most precise, at an even pixel (Texels).
  PinholeCamera& k = out.camera.intrinsics;
  const int middle_x = k.width / 4 * 2, middle_y = k.height / 4 * 2;
  k.cx -= middle_x;
  k.cy -= middle_y;
  out.step_x = -middle_x;
  out.step_y = -middle_y;
  out.depths = view.depths;
  TESSERA_ASSIGN_OR_RETURN(const StoredTexels stored, view.pixels->Level(level));
  out.stored = stored.WithOrigin(middle_x, middle_y);
  if (!with_likelihoods) out.stored->classes = 0;
  return out;
}

PhotoOptions MakePhotoOptions(const DataOptions& options) {
  PhotoOptions out = options.photo;
  out.window = MakeWindow(options.window_px, options.gaussian_window, out.window);
  out.semantic_weight = static_cast<float>(options.semantic);
  if (options.contour > 0) out.visitor_margin_px = ContourProfile::kReach;
  return out;
}

}  // namespace

int ReferenceMargin_px(int window_px, int level) {
  return (std::max(2 * (window_px / 2), ContourProfile::kReach) + 1) << level;
}

int TargetMargin_px(int level) { return 2 << level; }

DataTerm::DataTerm(const std::vector<RefineView>& views, const std::vector<ViewPair>& pairs, const ViewGroups& groups,
                   const MeshCells* cells, bool uses_likelihoods, const DataOptions& options)
    : refine_views_(views), groups_(groups), cells_(cells), uses_likelihoods_(uses_likelihoods), options_(options) {
  for (const ViewPair& pair : pairs) {
    PairsIn(PairDirections::kBoth).push_back(pair);
    PairsIn(pair.reference < pair.other ? PairDirections::kForward : PairDirections::kBackward).push_back(pair);
  }
}

Status DataTerm::EnterLevel(int level) {
  if (level == level_) return absl::OkStatus();
  const bool with_likelihoods = uses_likelihoods_ && (options_.semantic > 0 || options_.contour > 0);
  level_ = -1;
  photo_.reset();
  views_.assign(refine_views_.size(), PhotoView());
  std::vector<Status> read(views_.size());
  ParallelForEach(views_.size(), 1, [&](int64_t i) {
    StatusOr<PhotoView> view = MakePhotoView(refine_views_[i], level, with_likelihoods);
    read[i] = view.status();
    if (view.ok()) views_[i] = *std::move(view);
  });
  for (const Status& status : read) TESSERA_RETURN_IF_ERROR(status);
  photo_ = std::make_unique<PhotoTerm>(&views_, MakePhotoOptions(options_), &groups_);
  level_ = level;
  return absl::OkStatus();
}

void DataTerm::Evaluate(const TriangleMesh& mesh, const std::vector<uint8_t>& own, PairDirections directions,
                        const Clock* clock, FaceDerivatives* out) {
  ContourOptions contour;
  contour.weight = options_.contour;
  contour.borders = options_.borders;
  contour.level = level_;
  std::vector<std::vector<FaceContour>> contours(views_.size());
  const auto find = [&](size_t index, const PhotoView& view, const FaceMap& map) {
    contours[index] = FindContours(mesh, mesh.labels, own, view, map, contour);
  };
  const bool has_contours = options_.contour > 0 && !mesh.labels.empty();
  photo_->Evaluate(PairsIn(directions), mesh, own, cells_, clock, &out->photo,
                   has_contours ? PhotoTerm::MapVisitor(find) : nullptr);
  std::vector<int32_t> ids;
  for (const RefineView& view : refine_views_) ids.push_back(view.id);
  out->contours = AddContours(contours, ids);
}

}  // namespace tessera
