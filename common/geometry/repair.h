// Repair of triangle meshes: cuts a mesh into an oriented manifold.
#pragma once

#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/geometry/mesh_defects.h"

namespace tessera {

struct RepairedMesh {
  TriangleMesh mesh;
  std::vector<int64_t> face_in_input;    // input index of each face of `mesh`
  std::vector<int64_t> vertex_in_input;  // input index of each vertex of `mesh`, or of the vertex that it copies
  std::vector<int64_t> removed_faces;    // input indices of the degenerate faces, ascending
  int64_t vertex_copies = 0;             // vertices of `mesh` added by cutting
  MeshDefects defects;                   // of the input
};

// Removes degenerate faces and unreferenced vertices, and cuts the mesh (by copying vertices) along edges with more
// than two faces, along edges with two faces of opposite orientation, and at vertices where several fans touch. Does
// not move vertices, flip faces, fill holes or merge vertices. Faces keep their order and labels; vertices keep their
// order, copies follow. A clean mesh stays unchanged, and repair is idempotent. Adds one line per kind of defect to
// `warnings` (may be null). INVALID_ARGUMENT as for CheckMesh. Thread-safe.
StatusOr<RepairedMesh> RepairMesh(const TriangleMesh& mesh, Warnings* warnings);

// Adds one line per kind of defect to `warnings` (may be null).
void WarnOfDefects(const MeshDefects& defects, Warnings* warnings);

}  // namespace tessera
