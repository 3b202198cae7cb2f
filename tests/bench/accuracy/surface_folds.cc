#include "tests/bench/accuracy/surface_folds.h"

#include "common/geometry/mesh_defects.h"

namespace tessera {

StatusOr<FoldCounter> FoldCounter::Create(const TriangleMesh& start) {
  TESSERA_ASSIGN_OR_RETURN(std::vector<FacePair> pairs, SelfIntersections(start));
  return FoldCounter(start, std::move(pairs));
}

StatusOr<SurfaceFolds> FoldCounter::Count(const TriangleMesh& mesh) const {
  if (mesh.faces.size() != guard_.start_normals().size()) {
    return absl::InvalidArgumentError("folds: the mesh has not the start's topology");
  }
  TESSERA_ASSIGN_OR_RETURN(const std::vector<FacePair> pairs, SelfIntersections(mesh));
  return SurfaceFolds{guard_.InvertedFaces(mesh.vertices), static_cast<int64_t>(NewPairs(start_pairs_, pairs).size())};
}

}  // namespace tessera
