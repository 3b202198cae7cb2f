// One-rings of a mesh in flat arrays: the topology used by the regularisers.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/csr_rows.h"
#include "common/geometry/mesh.h"

namespace tessera {

// A vertex with an edge that does not have exactly two faces is on the mesh boundary.
struct OneRings {
  std::vector<uint32_t> begin;  // neighbours of v: to[begin[v] .. begin[v + 1]), ascending
  std::vector<uint32_t> to;
  std::vector<uint8_t> inner;        // per entry of `to`: the edge has two faces
  std::vector<uint8_t> on_boundary;  // per vertex
  // The two neighbours along the boundary, for boundary vertices with exactly two boundary edges; else v itself
  // twice.
  std::vector<std::array<uint32_t, 2>> along_boundary;

  uint32_t degree(size_t v) const { return begin[v + 1] - begin[v]; }
};

// The first corner of a face that is this vertex, which must be one of them.
inline int CornerOf(const Triangle& face, size_t vertex) { return face[0] == vertex ? 0 : face[1] == vertex ? 1 : 2; }

// The faces of each vertex, ascending.
CsrRows FacesOfVertices(const TriangleMesh& mesh);

// `faces_of_vertex`: of the mesh.
OneRings FindOneRings(const TriangleMesh& mesh, const CsrRows& faces_of_vertex);

}  // namespace tessera
