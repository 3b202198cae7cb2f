#include "worker/tile/repair_core.h"

#include "common/base/pick.h"
#include "worker/tile/regions.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

// Where each face may lie between two places, with room for what FaceBoxes rounds.
std::vector<Eigen::AlignedBox3d> SweptBoxes(const std::vector<Triangle>& faces, const std::vector<Vector3d>& from,
                                            const std::vector<Vector3d>& to) {
  std::vector<Eigen::AlignedBox3d> boxes(faces.size());
  for (size_t f = 0; f < boxes.size(); ++f) {
    for (const uint32_t v : faces[f]) boxes[f].extend(from[v]).extend(to[v]);
    const Vector3d room = 1e-6 * (boxes[f].min().cwiseAbs().cwiseMax(boxes[f].max().cwiseAbs()) + Vector3d::Ones());
    boxes[f] = {boxes[f].min() - room, boxes[f].max() + room};
  }
  return boxes;
}

}  // namespace

CoreRepair RepairCore(const RegionMesh& region, const std::vector<uint8_t>& core, double gsd_m,
                      const StepperOptions& options, const std::vector<Vector3d>& good,
                      std::vector<Vector3d>* positions) {
  const TriangleMesh& all = region.mesh;
  const IndexRows faces_of_vertex = FacesOfVertices(all);
  const std::vector<uint8_t> read =
      FacesForRepair(all, faces_of_vertex, core, RepairReachOf(options), SweptBoxes(all.faces, good, *positions));
  const PickedMesh part = PickFlagged(all, read);
  std::vector<uint8_t> boundary;
  for (const uint32_t v : part.vertices) {
    bool some_missing = !region.boundary.empty() && region.boundary[v] != 0;
    for (const uint32_t f : faces_of_vertex[v]) some_missing |= !read[f];
    boundary.push_back(some_missing);
  }
  const MotionGuard guard(part.mesh, boundary, MakeMotionLimits(options, gsd_m));
  const auto keeps_facing = [&](uint32_t face, const auto& from, const auto& to) {
    return guard.KeepsFacing(face, from, to);
  };
  std::vector<Vector3d> moved = Pick(*positions, part.vertices);
  const FoldRepair::Result repaired =
      FoldRepair(part.mesh, guard.faces_of_vertex()).Run(Pick(good, part.vertices), keeps_facing, &moved);
  for (size_t v = 0; v < moved.size(); ++v) (*positions)[part.vertices[v]] = moved[v];
  CoreRepair out;
  out.changed_vertices = repaired.changed_vertices;
  for (const uint32_t f : repaired.left) out.left_faces += core[part.faces[f]];
  return out;
}

}  // namespace tessera
