#include "common/geometry/edge_list.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/unit/common/geometry/meshes.h"

namespace tessera {
namespace {

bool HasDirectedEdge(const Triangle& face, uint32_t from, uint32_t to) {
  for (int k = 0; k < 3; ++k)
    if (face[k] == from && face[(k + 1) % 3] == to) return true;
  return false;
}

// What must hold for every manifold mesh.
void CheckEdges(const TriangleMesh& mesh) {
  size_t rim_edges = 0;
  for (const Triangle& f : mesh.faces) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t from = f[k], to = f[(k + 1) % 3];
      rim_edges += std::none_of(mesh.faces.begin(), mesh.faces.end(),
                                [&](const Triangle& g) { return HasDirectedEdge(g, to, from); });
    }
  }
  const std::vector<MeshEdge> edges = EdgeList(mesh.faces);
  EXPECT_EQ(2 * edges.size(), 3 * mesh.faces.size() + rim_edges);
  for (size_t e = 0; e < edges.size(); ++e) {
    const MeshEdge& edge = edges[e];
    EXPECT_LT(edge.a, edge.b);
    if (e > 0) {
      EXPECT_LT(std::pair(edges[e - 1].a, edges[e - 1].b), std::pair(edge.a, edge.b));
    }
    EXPECT_GE(std::max(edge.left, edge.right), 0);
    if (edge.left >= 0) {
      EXPECT_TRUE(HasDirectedEdge(mesh.faces[edge.left], edge.a, edge.b));
    }
    if (edge.right >= 0) {
      EXPECT_TRUE(HasDirectedEdge(mesh.faces[edge.right], edge.b, edge.a));
    }
    rim_edges -= edge.left < 0 || edge.right < 0;
  }
  EXPECT_EQ(rim_edges, 0u);
}

TEST(EdgeList, HoldsEachEdgeOnceOnOpenAndClosedMeshes) {
  CheckEdges(Tetrahedron());
  CheckEdges(Torus(7, 5));
  CheckEdges(Grid(1, 1));
  CheckEdges(Grid(9, 6));
  CheckEdges(TriangleMesh{});
}

TEST(EdgeList, IsRightForAnyOrderOfFaces) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    TriangleMesh mesh = seed % 2 ? Grid(6, 5) : Torus(6, 5);
    Random random(seed);
    for (size_t f = mesh.faces.size() - 1; f > 0; --f)
      std::swap(mesh.faces[f], mesh.faces[random.Below(int64_t(f) + 1)]);
    CheckEdges(mesh);
  }
}

}  // namespace
}  // namespace tessera
