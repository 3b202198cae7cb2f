// Repair of triangle meshes: welds, turns and cuts a mesh into an oriented manifold.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"
#include "common/geometry/mesh_defects.h"
#include "common/geometry/orientation.h"
#include "common/geometry/stray_faces.h"
#include "common/geometry/viewpoint.h"

namespace tessera {

struct RepairedMesh {
  TriangleMesh mesh;
  std::vector<int64_t> face_in_input;    // input index of each face of `mesh`
  std::vector<int64_t> vertex_in_input;  // input index of each vertex of `mesh`, or of the vertex that it copies
  std::vector<int64_t> removed_faces;    // input indices of the degenerate and stray faces, ascending
  int64_t vertex_copies = 0;             // vertices of `mesh` added by cutting
  MeshDefects defects;                   // of the input
};

// Removes degenerate faces and unreferenced vertices, and cuts the mesh (by copying vertices) along edges with more
// than two faces, along edges with two faces of opposite orientation, and at vertices where several fans touch. Does
// not move vertices, flip faces, fill holes or merge vertices. Faces keep their order and labels; vertices keep their
// order, copies follow. A clean mesh stays unchanged, and repair is idempotent. Adds one line per kind of defect to
// `warnings` (may be null). INVALID_ARGUMENT as for CheckMesh. Thread-safe.
StatusOr<RepairedMesh> CutMesh(const TriangleMesh& mesh, Warnings* warnings);

struct RepairOptions {
  std::vector<Viewpoint> views;  // empty: no vertex is stray, and faces are only turned to agree
  Eigen::Vector3d file_origin = Eigen::Vector3d::Zero();  // (0, 0, 0) of the mesh's file, in the mesh's frame
  size_t max_faces_for_rays = 4 << 20;                    // in larger meshes, occlusion is tested with a coarse mesh
  std::string scratch_folder = {};                        // for these
  std::string file = {};                                  // for errors; may be empty
};

// CutMesh after these repairs, in this order:
// 1. Stray vertices are removed with their faces (FindStrayFaces). INVALID_ARGUMENT if these are more than 10 % of the
//    faces.
// 2. Borders at the same place are welded, if exactly two faces meet there (FindCoincidentEdges). The lowest vertex of
//    a place is kept.
// 3. Faces are turned to agree with their neighbours and the views (FaceOrientation), by exchanging their last two
//    vertices. Borders of faces that cannot agree are not welded.
// A mesh without such faults has the result of CutMesh. RESOURCE_EXHAUSTED if the scratch folder is full.
StatusOr<RepairedMesh> RepairMesh(const TriangleMesh& mesh, const RepairOptions& options, Warnings* warnings);

// The steps of RepairMesh before it cuts, for meshes in memory or on disk. Step 1; changes vertices and faces. Returns
// the stray faces, which do not count as faces from here on, ascending.
StatusOr<std::vector<uint32_t>> DropStrayFaces(const RepairOptions& options, std::span<Eigen::Vector3d> vertices,
                                               std::span<Triangle> faces, MeshDefects* defects);
// Steps 2 and 3; changes `faces`. `open_edges`: start corners 3 f + k of the edges with one face; `orientation`: has
// joined the faces of edges with two faces. Whether anything changed.
StatusOr<bool> WeldAndTurn(const RepairOptions& options, std::span<const Eigen::Vector3d> vertices,
                           std::span<const uint64_t> open_edges, FaceOrientation* orientation,
                           std::span<Triangle> faces, MeshDefects* defects);
// The defects of an input: `before` without what cutting finds, which is `at_cut`.
MeshDefects CombinedDefects(const MeshDefects& before, const MeshDefects& at_cut);

// Adds one line per kind of defect to `warnings` (may be null).
void WarnOfDefects(const MeshDefects& defects, Warnings* warnings);

}  // namespace tessera
