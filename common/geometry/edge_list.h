// The edges of a triangle mesh, each once, with the faces on both sides.
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"

namespace tessera {

// An edge between vertices a < b. `left` is the face that has the edge from a to b, `right` the one that has it from b
// to a; -1: no face (boundary).
struct MeshEdge {
  uint32_t a = 0, b = 0;
  int32_t left = -1, right = -1;
  friend bool operator==(const MeshEdge&, const MeshEdge&) = default;
};

// A side of a face, between vertices a < b. `face_corner`: 3 f + k of the side from corner k of face f to the next.
struct FaceSide {
  uint32_t a = 0, b = 0, face_corner = 0;
};

// The sides of all faces, ordered by (a, b, face_corner). Any mesh of fewer than 2^32 / 3 faces.
std::vector<FaceSide> SortedSides(const std::vector<Triangle>& faces);

// Every edge once, ordered by (a, b). The faces must be consistently oriented, with at most two faces at an edge. The
// vertices need not be manifold, so `faces` may be any part of a manifold mesh; its edges then come in the same order.
std::vector<MeshEdge> EdgeList(const std::vector<Triangle>& faces);

}  // namespace tessera
