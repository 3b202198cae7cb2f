#include "worker/tasks/cut_tile.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "common/base/parallel.h"
#include "common/geometry/repair.h"
#include "worker/tasks/collected_faces.h"
#include "worker/visibility/rasterizer.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
constexpr double kMotion_gsd = 64;  // more than a run may take a surface from its start

enum class Part : uint8_t { kOutside, kHalo, kCore };

Part PartOf(const Eigen::Vector3d& centroid, const GroundPlane& ground, const CutParameters& p) {
  if (p.tile.core.Contains(ground.Cell(centroid))) return Part::kCore;
  const double distance_m = DistanceToRect(ground.Coordinates(centroid), p.tile.core, ground.cell_m);
  return distance_m <= p.halo_m ? Part::kHalo : Part::kOutside;
}

StatusOr<CollectedFaces> FacesOfTile(const CityReader& city, const GroundPlane& ground, const CutParameters& p) {
  FaceCollector found;
  for (size_t b = 0; b < city.block_count(); ++b) {
    if (DistanceBetween(city.cells(b), p.tile.core, ground.cell_m) > p.halo_m) continue;
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(b));
    std::vector<Part> parts(block.face_ids.size());
    ParallelFor(static_cast<int64_t>(parts.size()), kGrain, [&](int64_t begin, int64_t end) {
      for (int64_t f = begin; f < end; ++f) parts[f] = PartOf(block.mesh.Centroid(f), ground, p);
    });
    for (size_t f = 0; f < parts.size(); ++f) {
      if (parts[f] != Part::kOutside) found.Add(block, f, parts[f] == Part::kCore);
    }
  }
  return found.Finish();
}

// 1 for vertices of the tile (`vertex_ids` ascending) that faces outside it use too.
StatusOr<std::vector<uint8_t>> UsedOutside(const CityReader& city, const GroundPlane& ground, const CutParameters& p,
                                           const CollectedFaces& tile) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& vertex : tile.mesh.vertices) box.extend(vertex);
  std::vector<uint8_t> used(tile.vertex_ids.size(), 0);
  for (size_t b = 0; b < city.block_count(); ++b) {
    if (!city.box(b).intersects(box)) continue;  // a shared vertex lies in both boxes
    TESSERA_ASSIGN_OR_RETURN(const CityBlock block, city.Block(b));
    // Where each of the block's vertices is in the tile; both lists ascend.
    std::vector<uint32_t> in_tile(block.vertex_ids.size(), kNone);
    bool any = false;
    size_t t = 0;
    for (size_t v = 0; v < in_tile.size(); ++v) {
      t = std::lower_bound(tile.vertex_ids.begin() + static_cast<std::ptrdiff_t>(t), tile.vertex_ids.end(),
                           block.vertex_ids[v]) -
          tile.vertex_ids.begin();
      if (t == tile.vertex_ids.size()) break;
      if (tile.vertex_ids[t] != block.vertex_ids[v]) continue;
      in_tile[v] = static_cast<uint32_t>(t);
      any = true;
    }
    if (!any) continue;
    for (size_t f = 0; f < block.face_ids.size(); ++f) {
      const Triangle& face = block.mesh.faces[f];
      if (in_tile[face[0]] == kNone && in_tile[face[1]] == kNone && in_tile[face[2]] == kNone) continue;
      if (PartOf(block.mesh.Centroid(f), ground, p) != Part::kOutside) continue;
      for (const uint32_t v : face) {
        if (in_tile[v] != kNone) used[in_tile[v]] = 1;
      }
    }
  }
  return used;
}

// Depths of all cells that look to the view, and of where their faces may move.
std::array<double, 2> DepthsOfView(const Survey& survey, int32_t view) {
  const PosedCamera& camera = survey.views[view].camera;
  double near_m = std::numeric_limits<double>::infinity(), far_m = 0;
  for (const SurveyCell& cell : survey.cells) {
    if (!std::binary_search(cell.views.begin(), cell.views.end(), view)) continue;
    for (const Eigen::Vector3d& corner : CornersOf(cell.box_min, cell.box_max)) {
      const double depth_m = camera.CameraFromWorld(corner).z();
      near_m = std::min(near_m, depth_m);
      far_m = std::max(far_m, depth_m);
    }
  }
  const double margin_m = kMotion_gsd * survey.gsd_m;
  return {std::max(near_m - margin_m, kNearPlane_m), std::max(far_m + margin_m, 2 * kNearPlane_m)};
}

// Which views look at which faces: as the survey's cells have it, so that no tiling changes it.
void FillCellViews(const Survey& survey, const std::map<int32_t, int32_t>& local_view, TilePackage* package) {
  std::map<std::pair<int, int>, const SurveyCell*> surveyed;
  for (const SurveyCell& cell : survey.cells) surveyed[{cell.x, cell.y}] = &cell;
  std::map<std::pair<int, int>, uint32_t> index;
  for (size_t f = 0; f < package->mesh.faces.size(); ++f) {
    const Eigen::Vector2i at = survey.ground.Cell(MeshSpans(package->mesh).Centroid(f));
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

StatusOr<TilePackage> CutTile(const CityReader& city, const Survey& survey, const CutParameters& p,
                              const OccluderOptions& occluders) {
  TESSERA_ASSIGN_OR_RETURN(CollectedFaces tile, FacesOfTile(city, survey.ground, p));
  if (std::find(tile.marked.begin(), tile.marked.end(), 1) == tile.marked.end()) {
    return absl::InvalidArgumentError("tile " + std::to_string(p.tile.tile) + ": found no faces in its core");
  }
  TESSERA_ASSIGN_OR_RETURN(const std::vector<uint8_t> used_outside, UsedOutside(city, survey.ground, p, tile));
  TilePackage package;
  package.face_ids = std::move(tile.face_ids);
  package.core = std::move(tile.marked);
  // Where the cut leaves fans of faces that touch in a vertex alone, it is doubled.
  TESSERA_ASSIGN_OR_RETURN(RepairedMesh repaired, RepairMesh(tile.mesh, nullptr));
  if (repaired.mesh.faces.size() != package.face_ids.size()) {
    return absl::InternalError("tile " + std::to_string(p.tile.tile) + ": faces were lost in cutting");
  }
  package.mesh = std::move(repaired.mesh);
  for (const int64_t v : repaired.vertex_in_input) {
    package.vertex_ids.push_back(tile.vertex_ids[v]);
    package.fixed.push_back(used_outside[v]);
  }

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
  FillCellViews(survey, local_view, &package);
  for (const auto& [reference, other] : survey.pairs) {
    const auto r = local_view.find(reference), o = local_view.find(other);
    if (r != local_view.end() && o != local_view.end()) package.pairs.push_back({r->second, o->second});
  }
  const auto in_tile = [&](const Eigen::Vector3d& centroid) {
    return PartOf(centroid, survey.ground, p) != Part::kOutside;
  };
  const OccluderSearch search(package.mesh, package.views);
  TESSERA_ASSIGN_OR_RETURN(const TriangleMesh found, FindOccluders(city, survey, in_tile, search));
  std::vector<uint8_t> near(found.faces.size());
  for (size_t f = 0; f < near.size(); ++f) {
    const Eigen::Vector3d centroid = MeshSpans(found).Centroid(f);
    const double distance_m =
        DistanceToRect(survey.ground.Coordinates(centroid), p.tile.core, survey.ground.cell_m) - p.halo_m;
    near[f] = distance_m <= occluders.near_gsd * survey.gsd_m;
  }
  package.occluders = ReduceOccluders(found, near, package.mesh, survey.ground, search, occluders);
  return package;
}

}  // namespace tessera
