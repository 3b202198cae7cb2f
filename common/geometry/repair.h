// Makes an oriented manifold of any triangle mesh by cutting, never by guessing.
#ifndef TESSERA_COMMON_GEOMETRY_REPAIR_H_
#define TESSERA_COMMON_GEOMETRY_REPAIR_H_

#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/geometry/mesh_defects.h"

namespace tessera {

struct RepairedMesh {
  TriangleMesh mesh;
  std::vector<int64_t> face_in_input;    // a face of `mesh`: its index in the input
  std::vector<int64_t> vertex_in_input;  // a vertex of `mesh`: the vertex of the input that it is, or is a copy of
  std::vector<int64_t> set_aside;        // faces of the input that were left out, ascending
  int64_t vertex_copies = 0;             // vertices of `mesh` that were added by cutting
  MeshDefects defects;                   // of the input
};

// Degenerate faces are set aside, vertices of no face dropped, and the mesh is cut along edges with more than two
// faces, along edges whose two faces are oriented against each other, and in vertices where fans touch. Nothing is
// moved, turned, filled or merged. Faces keep their order and labels; vertices keep their order, copies come after
// them. A clean mesh passes unchanged; repairing twice is repairing once. Each kind of defect adds one line to
// `warnings` (may be null). INVALID_ARGUMENT as CheckMesh. Thread-safe.
StatusOr<RepairedMesh> RepairMesh(const TriangleMesh& mesh, Warnings* warnings);

// One line to `warnings` (may be null) for each kind of defect that there is.
void WarnOfDefects(const MeshDefects& defects, Warnings* warnings);

}  // namespace tessera

#endif  // TESSERA_COMMON_GEOMETRY_REPAIR_H_
