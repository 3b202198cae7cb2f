// Defects by which a triangle mesh is not an oriented manifold.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"

namespace tessera {

// The number of occurrences of a defect, and the lowest face or vertex index with it; -1: none.
struct DefectCount {
  int64_t count = 0;
  int64_t first = -1;
};

// Edges and vertices are checked with respect to the faces that are not degenerate.
struct MeshDefects {
  // Degenerate faces; each is counted once, for the first of these kinds that applies.
  DefectCount repeated_vertex_faces;  // a vertex index occurs twice
  DefectCount zero_area_faces;        // corners are exactly collinear
  DefectCount duplicate_faces;        // the same three vertices as an earlier face, in any order
  DefectCount non_manifold_edges;     // three or more faces; `first` is the lower vertex of the edge
  DefectCount conflicting_edges;      // two faces with opposite orientation; `first` as above
  DefectCount non_manifold_vertices;  // several fans of faces that share only this vertex
  DefectCount unreferenced_vertices;  // in no face, or only in degenerate faces
  int64_t boundary_edges = 0;         // edges with one face; not a defect
  // Found by RepairMesh only.
  DefectCount stray_vertices;   // far from all that the views show; in faces
  int64_t stray_faces = 0;      // faces with such a vertex
  DefectCount welded_vertices;  // at the same place as an earlier vertex, on a border that both share
  DefectCount turned_faces;     // with an orientation against their neighbours or the views
  DefectCount small_pieces;     // pieces that the views hardly show; `first` is a face; not a defect
  bool IsClean() const;
};

// INVALID_ARGUMENT if a vertex index is out of range, a position is not finite, or the number of labels is neither 0
// nor the number of faces. Thread-safe.
StatusOr<MeshDefects> CheckMesh(const TriangleMesh& mesh);

// Pairs of non-adjacent faces that intersect or overlap (CGAL), lower index first, ascending. FAILED_PRECONDITION
// unless `mesh` is an oriented manifold. Takes seconds per million faces. Thread-safe.
StatusOr<std::vector<std::array<uint32_t, 2>>> SelfIntersections(const TriangleMesh& mesh);

// The errors of CheckMesh.
Status CheckMeshArrays(const TriangleMesh& mesh);

// The result of CheckMesh, and the data that RepairMesh needs.
struct MeshAnalysis {
  MeshDefects defects;
  std::vector<uint8_t> is_degenerate;  // per face; also those in `dropped`
  // Corner 3 f + k is vertex k of face f. Corners that are connected across manifold edges (two faces, consistent
  // orientation) form a fan; its id is the lowest of these corners. Undefined for degenerate faces.
  std::vector<uint32_t> fan_of_corner;
  // Edges with one face, and edges with two faces: the start corners of the faces' directed edges. By ascending lower
  // vertex.
  std::vector<uint32_t> open_edges;
  std::vector<std::array<uint32_t, 2>> paired_edges;
};
// `dropped`: faces that count as removed, ascending.
StatusOr<MeshAnalysis> AnalyseMesh(const TriangleMesh& mesh, std::span<const uint32_t> dropped = {});

// The same for a part of a mesh: all faces of the owned vertices [owned_begin, owned_end) are present, faces of other
// vertices may be missing. Counts only defects of owned vertices, and of faces and edges whose lowest vertex is owned.
// Fans are valid only at owned vertices. If each vertex is owned by one part, each defect of the whole is counted once,
// and each edge is listed once.
StatusOr<MeshAnalysis> AnalyseMeshPart(const TriangleMesh& mesh, size_t owned_begin, size_t owned_end,
                                       std::span<const uint32_t> dropped = {});

}  // namespace tessera
