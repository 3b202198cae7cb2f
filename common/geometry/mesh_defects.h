// What keeps a triangle mesh from being an oriented manifold.
#ifndef TESSERA_COMMON_GEOMETRY_MESH_DEFECTS_H_
#define TESSERA_COMMON_GEOMETRY_MESH_DEFECTS_H_

#include <array>
#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"

namespace tessera {

// How often a defect occurs, and the lowest index (of a face, or of a vertex) where; -1 if nowhere.
struct DefectCount {
  int64_t count = 0;
  int64_t first = -1;
};

// Edges and vertices are judged over the faces that are not degenerate.
struct MeshDefects {
  // Degenerate faces, each counted once, as the first of these that it is.
  DefectCount repeated_vertex_faces;  // the same index twice
  DefectCount zero_area_faces;        // corners exactly on one line
  DefectCount duplicate_faces;        // the same three vertices as an earlier face, in any order
  DefectCount non_manifold_edges;     // three or more faces; `first` is its smaller vertex
  DefectCount conflicting_edges;      // two faces that run along it the same way; `first` as above
  DefectCount non_manifold_vertices;  // fans that touch in this vertex alone
  DefectCount unreferenced_vertices;  // in no face, or in degenerate ones only
  int64_t boundary_edges = 0;         // one face; no defect
  bool IsClean() const;
};

// INVALID_ARGUMENT if a face names a vertex that is not there, a position is not finite, or labels are neither none nor
// one a face. Thread-safe.
StatusOr<MeshDefects> CheckMesh(const TriangleMesh& mesh);

// The pairs of faces that cut or overlap each other without being neighbours (CGAL), lower index first, ascending.
// `mesh` must be an oriented manifold: FAILED_PRECONDITION otherwise. Takes seconds a million faces. Thread-safe.
StatusOr<std::vector<std::array<uint32_t, 2>>> SelfIntersections(const TriangleMesh& mesh);

// The same as CheckMesh, with what RepairMesh needs beside it.
struct MeshAnalysis {
  MeshDefects defects;
  std::vector<uint8_t> is_degenerate;  // a face
  // Corner 3 f + k of face f stands for its vertex on f's side. Corners that are joined by edges with exactly two faces
  // of opposite direction have the same fan: the lowest of these corners. Meaningless for degenerate faces.
  std::vector<uint32_t> fan_of_corner;
};
StatusOr<MeshAnalysis> AnalyseMesh(const TriangleMesh& mesh);

// The same for the vertices [owned_begin, owned_end) of a mesh that has all faces of these, but not all of the others:
// defects are counted at owned vertices alone (faces and edges where their smallest vertex is owned), and fans mean
// something at owned vertices alone. Parts that own every vertex once find each defect of the whole once.
StatusOr<MeshAnalysis> AnalyseMeshPart(const TriangleMesh& mesh, size_t owned_begin, size_t owned_end);

}  // namespace tessera

#endif  // TESSERA_COMMON_GEOMETRY_MESH_DEFECTS_H_
