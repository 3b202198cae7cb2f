#include "worker/tasks/cut_tile.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "common/base/parallel.h"
#include "common/geometry/repair.h"

namespace tessera {
namespace {

constexpr int64_t kGrain = 4096;
constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
constexpr double kOriginStep_m = 1024;

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

Eigen::Vector3d OriginNear(const TriangleMesh& mesh) {
  Eigen::Vector3d low = mesh.vertices[0], high = low;
  for (const Eigen::Vector3d& p : mesh.vertices) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Eigen::Vector3d middle = (low + high) / (2 * kOriginStep_m);
  return kOriginStep_m * Eigen::Vector3d(std::round(middle.x()), std::round(middle.y()), std::round(middle.z()));
}

}  // namespace

StatusOr<TilePackage> CutTile(const City& city, const Survey& survey, const CutParameters& p,
                              const OccluderOptions& occluders) {
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
  package.origin = OriginNear(package.mesh);
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
  }
  for (const auto& [reference, other] : survey.pairs) {
    const auto r = local_view.find(reference), o = local_view.find(other);
    if (r != local_view.end() && o != local_view.end()) package.pairs.push_back({r->second, o->second});
  }
  std::vector<uint8_t> in_tile(parts.size());
  for (size_t f = 0; f < parts.size(); ++f) in_tile[f] = parts[f] != Part::kOutside;
  const OccluderSearch search(package.mesh, package.views);
  const std::vector<uint32_t> found_ids = FindOccluders(mesh, survey, in_tile, search);
  std::vector<uint32_t> unused;
  const TriangleMesh found = Extract(mesh, found_ids, &unused);
  std::vector<uint8_t> near(found.faces.size());
  for (size_t f = 0; f < near.size(); ++f) {
    const Eigen::Vector3d centroid = (found.Corner(f, 0) + found.Corner(f, 1) + found.Corner(f, 2)) / 3;
    const double distance_m =
        DistanceToRect(survey.ground.Coordinates(centroid), p.tile.core, survey.ground.cell_m) - p.halo_m;
    near[f] = distance_m <= occluders.near_gsd * survey.gsd_m;
  }
  package.occluders = ReduceOccluders(found, near, package.mesh, survey.ground, search, occluders);
  return package;
}

}  // namespace tessera
