#include "worker/tasks/occluders.h"

#include <algorithm>
#include <array>
#include <map>
#include <utility>

#include "common/base/parallel.h"
#include "worker/tasks/collected_faces.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
constexpr int kSilhouetteMargin_px = 16;  // around what a view sees of the tile: occluders' edges just outside it too

std::array<Eigen::Vector3d, 8> CornersOf(const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  std::array<Eigen::Vector3d, 8> corners;
  for (int k = 0; k < 8; ++k) {
    for (int axis = 0; axis < 3; ++axis) corners[k][axis] = (k >> axis & 1) ? high[axis] : low[axis];
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

bool OccluderSearch::MayHide(const SurveyCell& cell) const { return MayHide(CornersOf(cell.box_min, cell.box_max)); }

StatusOr<TriangleMesh> FindOccluders(const CityReader& city, const Survey& survey,
                                     const std::function<bool(const Eigen::Vector3d&)>& in_tile,
                                     const OccluderSearch& search) {
  FaceCollector found;
  for (size_t b = 0; b < city.block_count(); ++b) {
    if (!search.MayHide(CornersOf(city.box(b).min(), city.box(b).max()))) continue;
    // Whole cells first.
    const CellRect& rect = city.cells(b);
    std::map<std::pair<int, int>, bool> cell_may_hide;
    for (int y = rect.y0; y < rect.y1; ++y) {
      auto cell = std::lower_bound(survey.cells.begin(), survey.cells.end(), std::pair(y, rect.x0),
                                   [](const SurveyCell& a, const auto& at) { return std::pair(a.y, a.x) < at; });
      for (; cell != survey.cells.end() && rect.Contains({cell->x, cell->y}); ++cell) {
        cell_may_hide[{cell->x, cell->y}] = search.MayHide(*cell);
      }
    }
    if (std::none_of(cell_may_hide.begin(), cell_may_hide.end(), [](const auto& cell) { return cell.second; }))
      continue;
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(b));
    std::vector<uint8_t> hides(block.face_ids.size(), 0);
    ParallelFor(static_cast<int64_t>(hides.size()), kGrain, [&](int64_t begin, int64_t end) {
      for (int64_t f = begin; f < end; ++f) {
        const Eigen::Vector3d centroid = block.mesh.Centroid(f);
        const Eigen::Vector2i cell = survey.ground.Cell(centroid);
        const auto it = cell_may_hide.find({cell.x(), cell.y()});
        if (it == cell_may_hide.end() || !it->second || in_tile(centroid)) continue;
        const std::array<Eigen::Vector3d, 3> corners = {block.mesh.Corner(f, 0), block.mesh.Corner(f, 1),
                                                        block.mesh.Corner(f, 2)};
        hides[f] = search.MayHide(corners);
      }
    });
    for (size_t f = 0; f < hides.size(); ++f) {
      if (hides[f]) found.Add(block, f, false);
    }
  }
  return found.Finish().mesh;
}

}  // namespace tessera
