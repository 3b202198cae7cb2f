#include "worker/tasks/occluders.h"

#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <utility>

#include "common/base/parallel.h"
#include "common/geometry/simplify.h"
#include "worker/tasks/collected_faces.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
constexpr int kSilhouetteMargin_px = 16;  // around what a view sees of the tile: occluders' edges just outside it too

// Where the map shows a face, or does so at most `margin_px` rows and columns away: 1.
std::vector<uint8_t> Widened(const FaceMap& map, int margin_px) {
  const auto widen = [margin_px](const uint8_t* in, int count, size_t stride, uint8_t* out) {
    int last = -2 * margin_px - 1;  // where a mark was seen, looking ahead by the margin
    for (int i = 0; i < count + margin_px; ++i) {
      if (i < count && in[i * stride]) last = i;
      const int at = i - margin_px;
      if (at >= 0 && at < count) out[at * stride] = i - last <= 2 * margin_px;
    }
  };
  std::vector<uint8_t> marks(map.face.size()), wide(marks.size());
  for (size_t i = 0; i < marks.size(); ++i) marks[i] = map.face[i] >= 0;
  for (int y = 0; y < map.height; ++y) {
    const size_t row = static_cast<size_t>(y) * map.width;
    widen(&marks[row], map.width, 1, &wide[row]);
  }
  for (int x = 0; x < map.width; ++x) widen(&wide[x], map.height, map.width, &marks[x]);
  return marks;
}

// Whether the hull of `points` may lie before the tile in the window.
bool MayHideIn(const OccluderSearch::Window& window, std::span<const Eigen::Vector3d> points) {
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

// The ids of faces with a pixel before the tile, or around it, in one of the windows: 1.
std::vector<uint8_t> FacesBefore(const TriangleMesh& tile, const TriangleMesh& found, const OccluderSearch& search) {
  std::vector<uint8_t> before(found.faces.size(), 0);
  Rasterizer rasterizer;
  FaceMap bare, map;
  for (const OccluderSearch::Window& window : search.windows()) {
    const CameraWindow part(window.camera, window.rect);
    rasterizer.Draw(tile, nullptr, part, &bare);
    rasterizer.Draw(found, &tile, part, &map);
    const std::vector<uint8_t> about_tile = Widened(bare, kSilhouetteMargin_px);
    for (size_t i = 0; i < map.face.size(); ++i) {
      if (map.face[i] >= 0 && about_tile[i]) before[map.face[i]] = 1;
    }
  }
  return before;
}

// Adds the faces that share a vertex with one that is marked: what falls between pixel centres lies next to what does
// not.
void AddRing(const TriangleMesh& mesh, std::vector<uint8_t>* marked) {
  std::vector<uint8_t> touched(mesh.vertices.size(), 0);
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    if (!(*marked)[f]) continue;
    for (const uint32_t v : mesh.faces[f]) touched[v] = 1;
  }
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Triangle& face = mesh.faces[f];
    if (touched[face[0]] || touched[face[1]] || touched[face[2]]) (*marked)[f] = 1;
  }
}

Eigen::AlignedBox3d BoxOf(const std::vector<Eigen::Vector3d>& points) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& p : points) box.extend(p);
  return box;
}

int FloorDivide(int a, int b) { return a >= 0 ? a / b : -((-a + b - 1) / b); }

// A mesh of its own of some faces of `mesh`.
TriangleMesh Part(const TriangleMesh& mesh, const std::vector<Triangle>& faces) {
  std::vector<uint32_t> ids;
  for (const Triangle& face : faces) ids.insert(ids.end(), face.begin(), face.end());
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  TriangleMesh part;
  for (const uint32_t v : ids) part.vertices.push_back(mesh.vertices[v]);
  for (Triangle face : faces) {
    for (uint32_t& v : face) v = static_cast<uint32_t>(std::lower_bound(ids.begin(), ids.end(), v) - ids.begin());
    part.faces.push_back(face);
  }
  return part;
}

void Append(const TriangleMesh& part, TriangleMesh* mesh) {
  const uint32_t base = static_cast<uint32_t>(mesh->vertices.size());
  mesh->vertices.insert(mesh->vertices.end(), part.vertices.begin(), part.vertices.end());
  for (const Triangle& face : part.faces) mesh->faces.push_back({base + face[0], base + face[1], base + face[2]});
}

}  // namespace

std::array<Eigen::Vector3d, 8> CornersOf(const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  std::array<Eigen::Vector3d, 8> corners;
  for (int k = 0; k < 8; ++k) {
    for (int axis = 0; axis < 3; ++axis) corners[k][axis] = (k >> axis & 1) ? high[axis] : low[axis];
  }
  return corners;
}

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

bool OccluderSearch::MayHide(std::span<const Eigen::Vector3d> points) const {
  return std::any_of(windows_.begin(), windows_.end(), [&](const Window& w) { return MayHideIn(w, points); });
}

bool OccluderSearch::MayHide(const SurveyCell& cell) const { return MayHide(CornersOf(cell.box_min, cell.box_max)); }

double OccluderSearch::Tolerance(std::span<const Eigen::Vector3d> points, double share_px) const {
  double tolerance_m = std::numeric_limits<double>::infinity();
  for (const Window& window : windows_) {
    if (!MayHideIn(window, points)) continue;
    double near_m = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3d& p : points) near_m = std::min(near_m, window.camera.CameraFromWorld(p).z());
    const PinholeCamera& pinhole = window.camera.intrinsics;
    tolerance_m = std::min(tolerance_m, share_px * std::max(near_m, 0.0) / std::max(pinhole.fx, pinhole.fy));
  }
  return tolerance_m;
}

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

TriangleMesh ReduceOccluders(const TriangleMesh& found, const std::vector<uint8_t>& near, const TriangleMesh& tile,
                             const GroundPlane& ground, const OccluderSearch& search, const OccluderOptions& options) {
  std::vector<uint8_t> kept(found.faces.size(), 1);
  if (options.only_seen) {
    kept = FacesBefore(tile, found, search);
    AddRing(found, &kept);
  }
  std::vector<Triangle> near_faces;
  std::map<std::pair<int, int>, std::vector<Triangle>> blocks;  // by (y, x)
  for (size_t f = 0; f < found.faces.size(); ++f) {
    if (near[f]) {
      near_faces.push_back(found.faces[f]);
    } else if (kept[f]) {
      const Eigen::Vector2i cell = ground.Cell((found.Corner(f, 0) + found.Corner(f, 1) + found.Corner(f, 2)) / 3);
      const int side = options.block_cells;
      blocks[{FloorDivide(cell.y(), side), FloorDivide(cell.x(), side)}].push_back(found.faces[f]);
    }
  }
  std::vector<TriangleMesh> parts = {Part(found, near_faces)};
  for (const auto& [position, faces] : blocks) parts.push_back(Part(found, faces));
  ParallelFor(static_cast<int64_t>(parts.size()), 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = std::max<int64_t>(begin, 1); i < end; ++i) {
      const Eigen::AlignedBox3d box = BoxOf(parts[i].vertices);
      parts[i] = SimplifyMesh(parts[i], search.Tolerance(CornersOf(box.min(), box.max()), options.share_px));
    }
  });
  TriangleMesh reduced;
  for (const TriangleMesh& part : parts) Append(part, &reduced);
  return reduced;
}

}  // namespace tessera
