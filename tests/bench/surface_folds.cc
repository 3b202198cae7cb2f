#include "tests/bench/surface_folds.h"

#include <algorithm>

#include "common/geometry/mesh_defects.h"
#include "common/geometry/topology.h"

namespace tessera {

StatusOr<FoldCounter> FoldCounter::Create(const TriangleMesh& start) {
  FoldCounter counter;
  TESSERA_ASSIGN_OR_RETURN(const MeshTopology topology, BuildTopology(start));
  TriangleMesh smoothed = start;
  for (int step = 0; step < kSmoothingSteps; ++step) {
    std::vector<Eigen::Vector3d> moved = smoothed.vertices;
    for (uint32_t v = 0; v < moved.size(); ++v) {
      const auto ring = topology.vertex_ring[v];
      if (ring.empty() || topology.OnRim(v)) continue;
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      for (const uint32_t neighbour : ring) mean += smoothed.vertices[neighbour];
      moved[v] = 0.5 * (moved[v] + mean / static_cast<double>(ring.size()));
    }
    smoothed.vertices = std::move(moved);
  }
  for (size_t f = 0; f < start.faces.size(); ++f) counter.smoothed_normals_.push_back(FaceNormal(smoothed, f));
  TESSERA_ASSIGN_OR_RETURN(counter.start_pairs_, SelfIntersections(start));
  return counter;
}

StatusOr<SurfaceFolds> FoldCounter::Count(const TriangleMesh& mesh) const {
  if (mesh.faces.size() != smoothed_normals_.size()) {
    return absl::InvalidArgumentError("folds: the mesh has not the start's topology");
  }
  SurfaceFolds folds;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    folds.turned_faces += FaceNormal(mesh, f).dot(smoothed_normals_[f]) < 0;
  }
  TESSERA_ASSIGN_OR_RETURN(const auto pairs, SelfIntersections(mesh));
  for (const auto& pair : pairs) {
    folds.crossing_pairs += !std::binary_search(start_pairs_.begin(), start_pairs_.end(), pair);
  }
  return folds;
}

}  // namespace tessera
