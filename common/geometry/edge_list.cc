#include "common/geometry/edge_list.h"

#include <algorithm>

namespace tessera {

std::vector<MeshEdge> EdgeList(const std::vector<Triangle>& faces) {
  struct Side {
    uint32_t a, b;
    int32_t face;
    bool left;
  };
  std::vector<Side> sides;
  sides.reserve(3 * faces.size());
  for (size_t f = 0; f < faces.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t from = faces[f][k], to = faces[f][(k + 1) % 3];
      sides.push_back({std::min(from, to), std::max(from, to), static_cast<int32_t>(f), from < to});
    }
  }
  std::sort(sides.begin(), sides.end(), [](const Side& x, const Side& y) {
    return x.a != y.a ? x.a < y.a : x.b != y.b ? x.b < y.b : x.face < y.face;
  });
  std::vector<MeshEdge> edges;
  edges.reserve(sides.size() / 2 + 1);
  for (const Side& side : sides) {
    if (edges.empty() || edges.back().a != side.a || edges.back().b != side.b)
      edges.push_back({side.a, side.b, -1, -1});
    (side.left ? edges.back().left : edges.back().right) = side.face;
  }
  return edges;
}

}  // namespace tessera
