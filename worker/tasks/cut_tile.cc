#include "worker/tasks/cut_tile.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <span>

#include "common/base/parallel.h"
#include "common/geometry/repair.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
constexpr double kMotion_gsd = 64;        // more than a run may take a surface from its start
constexpr int kSilhouetteMargin_px = 16;  // around what a view sees of the tile: occluders' edges just outside it too

enum class Part : uint8_t { kOutside, kHalo, kCore };

std::vector<Part> PartsOfFaces(const TriangleMesh& mesh, const GroundPlane& ground, const CutParameters& p) {
  std::vector<Part> parts(mesh.faces.size());
  ParallelFor(static_cast<int64_t>(parts.size()), kGrain, [&](int64_t begin, int64_t end) {
    for (int64_t f = begin; f < end; ++f) {
      const Eigen::Vector3d centroid = (mesh.Corner(f, 0) + mesh.Corner(f, 1) + mesh.Corner(f, 2)) / 3;
      if (p.tile.core.Contains(ground.Cell(centroid))) {
        parts[f] = Part::kCore;
      } else {
        const double distance_m = DistanceToRect(ground.Coordinates(centroid), p.tile.core, ground.cell_m);
        parts[f] = distance_m <= p.halo_m ? Part::kHalo : Part::kOutside;
      }
    }
  });
  return parts;
}

// The faces in `ids` (ascending) with the vertices they use, in the order of the vertices' ids.
TriangleMesh Extract(const TriangleMesh& mesh, const std::vector<uint32_t>& ids, std::vector<uint32_t>* vertex_ids) {
  std::vector<uint32_t> local(mesh.vertices.size(), kNone);
  for (const uint32_t f : ids) {
    for (const uint32_t v : mesh.faces[f]) local[v] = 0;
  }
  TriangleMesh part;
  vertex_ids->clear();
  for (size_t v = 0; v < local.size(); ++v) {
    if (local[v] == kNone) continue;
    local[v] = static_cast<uint32_t>(part.vertices.size());
    part.vertices.push_back(mesh.vertices[v]);
    vertex_ids->push_back(static_cast<uint32_t>(v));
  }
  for (const uint32_t f : ids) {
    const Triangle& face = mesh.faces[f];
    part.faces.push_back({local[face[0]], local[face[1]], local[face[2]]});
    if (!mesh.labels.empty()) part.labels.push_back(mesh.labels[f]);
  }
  return part;
}

std::array<Eigen::Vector3d, 8> BoxCorners(const SurveyCell& cell) {
  std::array<Eigen::Vector3d, 8> corners;
  for (int k = 0; k < 8; ++k) {
    for (int axis = 0; axis < 3; ++axis) corners[k][axis] = (k >> axis & 1) ? cell.box_max[axis] : cell.box_min[axis];
  }
  return corners;
}

// What a view sees of the tile: occluders are looked for in front of it.
struct ViewWindow {
  PosedCamera camera;
  PixelRect rect;
  double depth_m = 0;  // of the tile's deepest vertex
};

std::vector<ViewWindow> WindowsOnTile(const TilePackage& package) {
  std::vector<ViewWindow> windows;
  for (const SceneView& view : package.views) {
    ViewWindow window = {view.camera, ProjectedBounds(package.mesh, view.camera, kSilhouetteMargin_px, 1), 0};
    if (window.rect.empty()) continue;
    for (const Eigen::Vector3d& p : package.mesh.vertices) {
      window.depth_m = std::max(window.depth_m, view.camera.CameraFromWorld(p).z());
    }
    windows.push_back(std::move(window));
  }
  return windows;
}

// Whether the convex hull of `points` may lie before the tile in the window.
bool MayHide(std::span<const Eigen::Vector3d> points, const ViewWindow& window) {
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

bool MayHideFromAny(std::span<const Eigen::Vector3d> points, const std::vector<ViewWindow>& windows) {
  return std::any_of(windows.begin(), windows.end(), [&](const ViewWindow& w) { return MayHide(points, w); });
}

std::vector<uint32_t> FindOccluders(const TriangleMesh& mesh, const std::vector<Part>& parts, const Survey& survey,
                                    const std::vector<ViewWindow>& windows) {
  // Whole cells first.
  std::map<std::pair<int, int>, bool> cell_may_hide;
  for (const SurveyCell& cell : survey.cells) {
    cell_may_hide[{cell.x, cell.y}] = MayHideFromAny(BoxCorners(cell), windows);
  }
  std::vector<uint8_t> hides(mesh.faces.size(), 0);
  ParallelFor(static_cast<int64_t>(mesh.faces.size()), kGrain, [&](int64_t begin, int64_t end) {
    for (int64_t f = begin; f < end; ++f) {
      if (parts[f] != Part::kOutside) continue;
      const std::array<Eigen::Vector3d, 3> corners = {mesh.Corner(f, 0), mesh.Corner(f, 1), mesh.Corner(f, 2)};
      const Eigen::Vector2i cell = survey.ground.Cell((corners[0] + corners[1] + corners[2]) / 3);
      const auto it = cell_may_hide.find({cell.x(), cell.y()});
      hides[f] = it != cell_may_hide.end() && it->second && MayHideFromAny(corners, windows);
    }
  });
  std::vector<uint32_t> faces;
  for (size_t f = 0; f < hides.size(); ++f) {
    if (hides[f]) faces.push_back(static_cast<uint32_t>(f));
  }
  return faces;
}

// 1 for vertices of the tile that faces outside it use too.
std::vector<uint8_t> VerticesOnCut(const TriangleMesh& mesh, const std::vector<Part>& parts,
                                   const std::vector<uint32_t>& vertex_ids) {
  std::vector<uint8_t> used_outside(mesh.vertices.size(), 0);
  for (size_t f = 0; f < parts.size(); ++f) {
    if (parts[f] != Part::kOutside) continue;
    for (const uint32_t v : mesh.faces[f]) used_outside[v] = 1;
  }
  std::vector<uint8_t> fixed(vertex_ids.size());
  for (size_t v = 0; v < fixed.size(); ++v) fixed[v] = used_outside[vertex_ids[v]];
  return fixed;
}

// Depths of all cells that look to the view, and of where their faces may move.
std::array<double, 2> DepthsOfView(const Survey& survey, int32_t view) {
  const PosedCamera& camera = survey.views[view].camera;
  double near_m = std::numeric_limits<double>::infinity(), far_m = 0;
  for (const SurveyCell& cell : survey.cells) {
    if (!std::binary_search(cell.views.begin(), cell.views.end(), view)) continue;
    for (const Eigen::Vector3d& corner : BoxCorners(cell)) {
      const double depth_m = camera.CameraFromWorld(corner).z();
      near_m = std::min(near_m, depth_m);
      far_m = std::max(far_m, depth_m);
    }
  }
  const double margin_m = kMotion_gsd * survey.gsd_m;
  return {std::max(near_m - margin_m, kNearPlane_m), std::max(far_m + margin_m, 2 * kNearPlane_m)};
}

// Which views look at which faces: as the survey's cells have it, so that no tiling changes it.
void FillCellViews(const TriangleMesh& mesh, const Survey& survey, const std::map<int32_t, int32_t>& local_view,
                   TilePackage* package) {
  std::map<std::pair<int, int>, const SurveyCell*> surveyed;
  for (const SurveyCell& cell : survey.cells) surveyed[{cell.x, cell.y}] = &cell;
  std::map<std::pair<int, int>, uint32_t> index;
  for (const uint32_t id : package->face_ids) {
    const Eigen::Vector2i at = survey.ground.Cell((mesh.Corner(id, 0) + mesh.Corner(id, 1) + mesh.Corner(id, 2)) / 3);
    const auto [entry, is_new] = index.try_emplace({at.x(), at.y()}, static_cast<uint32_t>(index.size()));
    package->cell.push_back(entry->second);
    if (!is_new) continue;
    std::vector<int32_t>& views = package->cell_views.emplace_back();
    const auto cell = surveyed.find({at.x(), at.y()});
    if (cell == surveyed.end()) continue;
    for (const int32_t view : cell->second->views) {
      if (const auto local = local_view.find(view); local != local_view.end()) views.push_back(local->second);
    }
  }
}

}  // namespace

StatusOr<TilePackage> CutTile(const City& city, const Survey& survey, const CutParameters& p) {
  const TriangleMesh& mesh = city.mesh;
  const std::vector<Part> parts = PartsOfFaces(mesh, survey.ground, p);
  TilePackage package;
  for (size_t f = 0; f < parts.size(); ++f) {
    if (parts[f] == Part::kOutside) continue;
    package.face_ids.push_back(static_cast<uint32_t>(f));
    package.core.push_back(parts[f] == Part::kCore ? 1 : 0);
  }
  if (std::find(package.core.begin(), package.core.end(), 1) == package.core.end()) {
    return absl::InvalidArgumentError("tile " + std::to_string(p.tile.tile) + ": found no faces in its core");
  }
  std::vector<uint32_t> used_ids;
  const TriangleMesh extracted = Extract(mesh, package.face_ids, &used_ids);
  // Where the cut leaves fans of faces that touch in a vertex alone, it is doubled.
  TESSERA_ASSIGN_OR_RETURN(RepairedMesh repaired, RepairMesh(extracted, nullptr));
  if (repaired.mesh.faces.size() != package.face_ids.size()) {
    return absl::InternalError("tile " + std::to_string(p.tile.tile) + ": faces were lost in cutting");
  }
  package.mesh = std::move(repaired.mesh);
  for (const int64_t v : repaired.vertex_in_input) package.vertex_ids.push_back(used_ids[v]);
  package.fixed = VerticesOnCut(mesh, parts, package.vertex_ids);

  package.tile = p.tile.tile;
  package.ground = survey.ground;
  package.gsd_m = survey.gsd_m;
  package.up = survey.up;
  package.classes = survey.classes;
  package.has_likelihoods = survey.has_likelihoods;
  std::map<int32_t, int32_t> local_view;
  for (const int32_t view : p.views) {
    if (view < 0 || view >= static_cast<int32_t>(survey.views.size())) {
      return absl::InvalidArgumentError("tile " + std::to_string(p.tile.tile) + ": found view " + std::to_string(view) +
                                        " of " + std::to_string(survey.views.size()));
    }
    local_view.emplace(view, static_cast<int32_t>(package.views.size()));
    package.views.push_back(survey.views[view]);
    package.view_depths.push_back(DepthsOfView(survey, view));
  }
  FillCellViews(mesh, survey, local_view, &package);
  for (const auto& [reference, other] : survey.pairs) {
    const auto r = local_view.find(reference), o = local_view.find(other);
    if (r != local_view.end() && o != local_view.end()) package.pairs.push_back({r->second, o->second});
  }
  std::vector<uint32_t> unused;
  package.occluders = Extract(mesh, FindOccluders(mesh, parts, survey, WindowsOnTile(package)), &unused);
  return package;
}

}  // namespace tessera
