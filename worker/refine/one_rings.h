// One-rings of a mesh as flat arrays: the topology under the regularisers.
#ifndef TESSERA_WORKER_REFINE_ONE_RINGS_H_
#define TESSERA_WORKER_REFINE_ONE_RINGS_H_

#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/mesh.h"

namespace tessera {

// A vertex on an edge that has not exactly two faces is on a rim.
struct OneRings {
  std::vector<uint32_t> begin;  // neighbours of v: to[begin[v] .. begin[v + 1]), by rising number
  std::vector<uint32_t> to;
  std::vector<uint8_t> inner;  // a neighbour: the edge to it has two faces
  std::vector<uint8_t> rim;    // a vertex
  // The neighbours along the rim of a rim vertex with exactly two rim edges; both v itself elsewhere.
  std::vector<std::array<uint32_t, 2>> along_rim;

  size_t vertices() const { return rim.size(); }
  uint32_t degree(size_t v) const { return begin[v + 1] - begin[v]; }
};

OneRings FindOneRings(const TriangleMesh& mesh);

}  // namespace tessera

#endif  // TESSERA_WORKER_REFINE_ONE_RINGS_H_
