#include "worker/tasks/occluders.h"

#include <algorithm>
#include <array>
#include <map>
#include <utility>

#include "common/base/parallel.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
constexpr int kSilhouetteMargin_px = 16;  // around what a view sees of the tile: occluders' edges just outside it too

std::array<Eigen::Vector3d, 8> CornersOf(const SurveyCell& cell) {
  std::array<Eigen::Vector3d, 8> corners;
  for (int k = 0; k < 8; ++k) {
    for (int axis = 0; axis < 3; ++axis) corners[k][axis] = (k >> axis & 1) ? cell.box_max[axis] : cell.box_min[axis];
  }
  return corners;
}

}  // namespace

OccluderSearch::OccluderSearch(const TriangleMesh& tile, const std::vector<SceneView>& views) {
  for (const SceneView& view : views) {
    Window window = {view.camera, ProjectedBounds(tile, view.camera, kSilhouetteMargin_px, 1), 0};
    if (window.rect.empty()) continue;
    for (const Eigen::Vector3d& p : tile.vertices) {
      window.depth_m = std::max(window.depth_m, view.camera.CameraFromWorld(p).z());
    }
    windows_.push_back(std::move(window));
  }
}

bool OccluderSearch::MayHide(std::span<const Eigen::Vector3d> points, const Window& window) {
  double x0 = 1e300, y0 = 1e300, x1 = -1e300, y1 = -1e300, near = 1e300;
  bool in_front = false, behind = false;
  for (const Eigen::Vector3d& point : points) {
    const Eigen::Vector3d p = window.camera.Project(point);
    near = std::min(near, p.z());
    if (p.z() <= 1e-3) {
      behind = true;
      continue;
    }
    in_front = true;
    x0 = std::min(x0, p.x());
    x1 = std::max(x1, p.x());
    y0 = std::min(y0, p.y());
    y1 = std::max(y1, p.y());
  }
  if (!in_front || near >= window.depth_m) return false;
  if (behind) return true;
  return x1 >= window.rect.x0 && x0 <= window.rect.x1 && y1 >= window.rect.y0 && y0 <= window.rect.y1;
}

bool OccluderSearch::MayHide(std::span<const Eigen::Vector3d> points) const {
  return std::any_of(windows_.begin(), windows_.end(), [&](const Window& w) { return MayHide(points, w); });
}

bool OccluderSearch::MayHide(const SurveyCell& cell) const { return MayHide(CornersOf(cell)); }

std::vector<uint32_t> FindOccluders(const TriangleMesh& city, const Survey& survey, const std::vector<uint8_t>& in_tile,
                                    const OccluderSearch& search) {
  // Whole cells first.
  std::map<std::pair<int, int>, bool> cell_may_hide;
  for (const SurveyCell& cell : survey.cells) cell_may_hide[{cell.x, cell.y}] = search.MayHide(cell);
  std::vector<uint8_t> hides(city.faces.size(), 0);
  ParallelFor(static_cast<int64_t>(city.faces.size()), kGrain, [&](int64_t begin, int64_t end) {
    for (int64_t f = begin; f < end; ++f) {
      if (in_tile[f]) continue;
      const std::array<Eigen::Vector3d, 3> corners = {city.Corner(f, 0), city.Corner(f, 1), city.Corner(f, 2)};
      const Eigen::Vector2i cell = survey.ground.Cell((corners[0] + corners[1] + corners[2]) / 3);
      const auto it = cell_may_hide.find({cell.x(), cell.y()});
      hides[f] = it != cell_may_hide.end() && it->second && search.MayHide(corners);
    }
  });
  std::vector<uint32_t> faces;
  for (size_t f = 0; f < hides.size(); ++f) {
    if (hides[f]) faces.push_back(static_cast<uint32_t>(f));
  }
  return faces;
}

}  // namespace tessera
