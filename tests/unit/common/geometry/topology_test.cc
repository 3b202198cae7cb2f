#include "common/geometry/topology.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "tests/unit/common/geometry/meshes.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

bool HasDirectedEdge(const Triangle& face, uint32_t from, uint32_t to) {
  for (int k = 0; k < 3; ++k)
    if (face[k] == from && face[(k + 1) % 3] == to) return true;
  return false;
}

// What must hold for every manifold mesh.
void CheckTopology(const TriangleMesh& mesh) {
  const StatusOr<MeshTopology> built = BuildTopology(mesh);
  ASSERT_TRUE(built.ok()) << built.status();
  const MeshTopology& topology = *built;
  ASSERT_EQ(topology.vertex_ring.size(), mesh.vertices.size());
  ASSERT_EQ(topology.vertex_faces.size(), mesh.vertices.size());
  ASSERT_EQ(topology.face_neighbours.size(), mesh.faces.size());

  size_t rim_edges = 0;
  for (uint32_t f = 0; f < mesh.faces.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t from = mesh.faces[f][k], to = mesh.faces[f][(k + 1) % 3];
      const int32_t g = topology.face_neighbours[f][k];
      rim_edges += g < 0;
      if (g < 0) {
        EXPECT_TRUE(topology.OnRim(from) && topology.OnRim(to));
        for (const Triangle& face : mesh.faces) EXPECT_FALSE(HasDirectedEdge(face, to, from));
      } else {
        EXPECT_TRUE(HasDirectedEdge(mesh.faces[g], to, from));
      }
    }
  }
  size_t corners = 0;
  for (uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    const auto ring = topology.vertex_ring[v];
    const auto faces = topology.vertex_faces[v];
    corners += faces.size();
    EXPECT_EQ(std::set<uint32_t>(ring.begin(), ring.end()).size(), ring.size());
    EXPECT_EQ(faces.size() + (topology.OnRim(v) ? 1 : 0), ring.size());
    if (!topology.OnRim(v) && !ring.empty()) {
      EXPECT_EQ(ring[0], *std::min_element(ring.begin(), ring.end()));
    }
    for (size_t k = 0; k < faces.size(); ++k) {
      EXPECT_TRUE(HasDirectedEdge(mesh.faces[faces[k]], v, ring[k]));
      EXPECT_TRUE(HasDirectedEdge(mesh.faces[faces[k]], ring[(k + 1) % ring.size()], v));
    }
  }
  EXPECT_EQ(corners, 3 * mesh.faces.size());

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

TEST(Topology, HoldsOnOpenAndClosedMeshes) {
  CheckTopology(Tetrahedron());
  CheckTopology(Torus(7, 5));
  CheckTopology(Grid(1, 1));
  CheckTopology(Grid(9, 6));
  CheckTopology(TriangleMesh{});
}

TEST(Topology, HoldsWhateverTheOrderOfFaces) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    TriangleMesh mesh = seed % 2 ? Grid(6, 5) : Torus(6, 5);
    Random random(seed);
    for (size_t f = mesh.faces.size() - 1; f > 0; --f)
      std::swap(mesh.faces[f], mesh.faces[random.Below(int64_t(f) + 1)]);
    CheckTopology(mesh);
  }
}

TEST(Topology, RingsOfASmallGrid) {
  // 3 4 5
  // 0 1 2  with diagonals 0-4 and 1-5.
  const StatusOr<MeshTopology> topology = BuildTopology(Grid(2, 1));
  ASSERT_TRUE(topology.ok());
  EXPECT_THAT(topology->vertex_ring[1], ElementsAre(2, 5, 4, 0));
  EXPECT_THAT(topology->vertex_faces[1], ElementsAre(2, 3, 0));
  EXPECT_THAT(topology->face_neighbours[0], ElementsAre(-1, 3, 1));
  EXPECT_TRUE(topology->OnRim(1));
}

TEST(Topology, VerticesOfNoFace) {
  TriangleMesh mesh = Tetrahedron();
  mesh.vertices.push_back({5, 5, 5});
  const StatusOr<MeshTopology> topology = BuildTopology(mesh);
  ASSERT_TRUE(topology.ok());
  EXPECT_TRUE(topology->vertex_ring[4].empty());
  EXPECT_FALSE(topology->OnRim(4));
}

TEST(Topology, RefusesWhatIsNoManifold) {
  const auto error = [](const TriangleMesh& mesh) {
    const StatusOr<MeshTopology> topology = BuildTopology(mesh);
    EXPECT_EQ(topology.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(topology.status().message());
  };
  TriangleMesh mesh = Grid(2, 2);
  mesh.faces[3] = {5, 1, 4};  // was 1, 5, 4
  EXPECT_THAT(error(mesh), HasSubstr("both have the edge from vertex"));
  mesh = Grid(2, 2);
  mesh.faces[0] = {0, 1, 99};
  EXPECT_THAT(error(mesh), HasSubstr("face 0 names vertex 99"));
  mesh.faces[0] = {0, 1, 1};
  EXPECT_THAT(error(mesh), HasSubstr("face 0 has vertex 1 twice"));
  // Two squares that meet in one vertex, open and closed.
  mesh = Grid(2, 2);
  mesh.faces = {mesh.faces[0], mesh.faces[1], mesh.faces[6], mesh.faces[7]};
  EXPECT_THAT(error(mesh), HasSubstr("vertex 4 form 2 fans"));
  mesh = Tetrahedron();
  const TriangleMesh other = Tetrahedron({-1, -1, -1});
  for (int v = 1; v < 4; ++v) mesh.vertices.push_back(other.vertices[v]);
  for (Triangle face : other.faces) {
    for (uint32_t& corner : face) corner = corner == 0 ? 0 : corner + 3;
    mesh.faces.push_back(face);
  }
  EXPECT_THAT(error(mesh), HasSubstr("not a manifold"));
}

}  // namespace
}  // namespace tessera
