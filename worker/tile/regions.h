// Which faces the operators read to get a core's vertices and labels right, by the bounds that stand beside them.
#ifndef TESSERA_WORKER_TILE_REGIONS_H_
#define TESSERA_WORKER_TILE_REGIONS_H_

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <vector>

#include "common/geometry/csr_rows.h"
#include "common/geometry/mesh.h"
#include "common/job/ground.h"
#include "worker/label/label_dependency.h"
#include "worker/refine/stepper.h"

namespace tessera {

struct RepairReach {
  std::vector<int> rings;  // of FoldRepair's passes, the last first; each is followed by a contact
  int start_rings = 0;     // of the smoothed start, about the faces of all of them
};
RepairReach RepairReachOf(const StepperOptions& options);

struct RegionReach {
  int solve_rings = 0;  // StepReach
  RepairReach repair;
  double contact_m = 0;  // faces that ever touch have boxes at the start no farther apart than this
  LabelReach label;
};

// Some faces of a mesh as a mesh of their own, labels too where it has them, in its order.
struct PickedMesh {
  TriangleMesh mesh;
  std::vector<uint32_t> vertices, faces;  // of each, which of the mesh's it is
};
// Those with a flag.
PickedMesh PickFlagged(const TriangleMesh& mesh, const std::vector<uint8_t>& faces);

// Grows flags of faces by rings: all faces that share a vertex with one that has a flag.
void GrowRings(const TriangleMesh& mesh, const IndexRows& faces_of_vertex, int rings, std::vector<uint8_t>* faces);

// Flags of the faces that FoldRepair and its test of faces read to get the vertices of `core` right. `boxes`: of each
// face, where it may lie meanwhile. What does not touch is kept apart in plan alone.
std::vector<uint8_t> FacesForRepair(const TriangleMesh& mesh, const IndexRows& faces_of_vertex,
                                    const std::vector<uint8_t>& core, const RepairReach& reach,
                                    const std::vector<Eigen::AlignedBox3d>& boxes);

// The cell of the label solver that a face belongs to, by its centroid at the start.
inline Cell LabelCellOf(const GroundPlane& ground, double gsd_m, const Eigen::Vector3d& centroid) {
  const Eigen::Vector2d at = ground.Coordinates(centroid) / (kLabelCellGsd * gsd_m);
  return {static_cast<int32_t>(std::floor(at.x())), static_cast<int32_t>(std::floor(at.y()))};
}

// The bits kCoreRegion to kLabelRegion of every face. `mesh`: where it lies at the start; `cell`: LabelCellOf each
// face; `core`: a flag a face. Right where the mesh has all faces about those that are found.
std::vector<uint8_t> FindRegions(const TriangleMesh& mesh, const IndexRows& faces_of_vertex,
                                 const std::vector<Cell>& cell, const std::vector<uint8_t>& core,
                                 const RegionReach& reach);

}  // namespace tessera

#endif  // TESSERA_WORKER_TILE_REGIONS_H_
