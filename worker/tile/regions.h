// Finds the faces that the operators read to compute a core's vertices and labels exactly, from their dependency
// radii.
#pragma once

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

struct RepairDependencyRadius {
  std::vector<int> rings;  // rings read by each pass of SurfaceRepair, the last pass first;
                           // after each also the faces that may touch those found
  int start_rings = 0;     // of the smoothed start, around all faces found so far
};
RepairDependencyRadius RepairDependencyRadiusOf(const StepperOptions& options);

struct RegionDependencyRadius {
  int solve_rings = 0;  // StepDependencyRadius
  RepairDependencyRadius repair;
  double contact_m = 0;  // distance between the boxes of faces that may touch in one of the tile's steps
  LabelDependencyRadius label;
};

// A submesh of some faces, with labels if the mesh has them, in the mesh's order.
struct PickedMesh {
  TriangleMesh mesh;
  std::vector<uint32_t> vertices, faces;  // index in the mesh of each of the submesh's
};
// The submesh of the flagged faces.
PickedMesh PickFlagged(const TriangleMesh& mesh, const std::vector<uint8_t>& faces);

// Dilates flags of faces by rings: a ring adds all faces that share a vertex with a flagged one.
void GrowRings(const TriangleMesh& mesh, const CsrRows& faces_of_vertex, int rings, std::vector<uint8_t>* faces);

// Flags the faces that SurfaceRepair and its face test read to compute the vertices of `core` exactly. `boxes`: per
// face, where it may be at any time. Contacts are tested in plan only, which is conservative.
std::vector<uint8_t> FacesForRepair(const TriangleMesh& mesh, const CsrRows& faces_of_vertex,
                                    const std::vector<uint8_t>& core, const RepairDependencyRadius& radius,
                                    const std::vector<Eigen::AlignedBox3d>& boxes);

// The label solver's cell of a face, by its centroid in the start.
inline Cell LabelCellOf(const GroundPlane& ground, double gsd_m, const Eigen::Vector3d& centroid) {
  const Eigen::Vector2d at = ground.Coordinates(centroid) / (kLabelCellGsd * gsd_m);
  return {static_cast<int32_t>(std::floor(at.x())), static_cast<int32_t>(std::floor(at.y()))};
}

// Region bits kCoreRegion to kLabelRegion of every face. `positions`: of the mesh's vertices, for which
// RegionDependencyRadius::contact_m holds; `cell`: LabelCellOf each face; `core`: one flag per face. Exact if the mesh
// contains all faces adjacent to those found.
std::vector<uint8_t> FindRegions(const TriangleMesh& mesh, const std::vector<Eigen::Vector3d>& positions,
                                 const CsrRows& faces_of_vertex, const std::vector<Cell>& cell,
                                 const std::vector<uint8_t>& core, const RegionDependencyRadius& radius);

}  // namespace tessera
