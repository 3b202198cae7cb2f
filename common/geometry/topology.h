// Who is next to whom in a manifold triangle mesh, as flat arrays.
#ifndef TESSERA_COMMON_GEOMETRY_TOPOLOGY_H_
#define TESSERA_COMMON_GEOMETRY_TOPOLOGY_H_

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/geometry/mesh.h"

namespace tessera {

// Rows of unequal length in one array: row i is items[offsets[i]] to items[offsets[i + 1] - 1].
struct IndexRows {
  std::vector<int64_t> offsets = {0};
  std::vector<uint32_t> items;
  size_t size() const { return offsets.size() - 1; }
  std::span<const uint32_t> operator[](size_t row) const {
    return {items.data() + offsets[row], static_cast<size_t>(offsets[row + 1] - offsets[row])};
  }
};

struct MeshTopology {
  // Neighbours of each vertex, counter-clockwise seen from outside. Inside the mesh the ring starts at the smallest
  // index; on the rim it starts and ends with the two rim neighbours. Empty for a vertex of no face.
  IndexRows vertex_ring;
  // Faces around each vertex in the order of its ring: face k lies between neighbours k and k + 1 (the last face of a
  // closed ring between the last and the first). One fewer than neighbours on the rim.
  IndexRows vertex_faces;
  // The face across the edge from corner k to corner k + 1 of each face; -1 on the rim.
  std::vector<std::array<int32_t, 3>> face_neighbours;

  bool OnRim(uint32_t vertex) const { return vertex_ring[vertex].size() != vertex_faces[vertex].size(); }
};

// Walks the mesh as half-edges (OpenMesh, double precision). The result depends on indices alone, so it is the same for
// the same mesh. INVALID_ARGUMENT naming a face or vertex if the mesh is not manifold, not consistently oriented, or
// names vertices that are not there; RepairMesh cures that. Thread-safe.
StatusOr<MeshTopology> BuildTopology(const TriangleMesh& mesh);

// An edge between vertices a < b; `left` is the face that has it as a to b, `right` as b to a; -1: none (rim).
struct MeshEdge {
  uint32_t a = 0, b = 0;
  int32_t left = -1, right = -1;
  friend bool operator==(const MeshEdge&, const MeshEdge&) = default;
};

// Every edge once, ordered by (a, b). Of faces that are consistently oriented, no more than two at an edge; that their
// vertices are manifold is not asked, so any part of a manifold mesh will do, and its edges come in the same order.
std::vector<MeshEdge> EdgeList(const std::vector<Triangle>& faces);

}  // namespace tessera

#endif  // TESSERA_COMMON_GEOMETRY_TOPOLOGY_H_
