#include "common/geometry/repair.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/boost/graph/helpers.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <set>

#include "common/base/parallel.h"
#include "tests/unit/common/geometry/meshes.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

double Area(const TriangleMesh& mesh) {
  double area = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) area += FaceArea(mesh, f);
  return area;
}

RepairedMesh Repaired(const TriangleMesh& mesh, Warnings* warnings = nullptr) {
  StatusOr<RepairedMesh> repaired = CutMesh(mesh, warnings);
  EXPECT_TRUE(repaired.ok()) << repaired.status();
  return *std::move(repaired);
}

bool CgalSaysManifold(const TriangleMesh& mesh) {
  namespace pmp = CGAL::Polygon_mesh_processing;
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  std::vector<std::array<std::size_t, 3>> faces;
  for (const Triangle& face : mesh.faces) faces.push_back({face[0], face[1], face[2]});
  if (!pmp::is_polygon_soup_a_polygon_mesh(faces)) return false;
  std::vector<Kernel::Point_3> points;
  for (const Eigen::Vector3d& p : mesh.vertices) points.emplace_back(p.x(), p.y(), p.z());
  CGAL::Surface_mesh<Kernel::Point_3> surface;
  pmp::polygon_soup_to_polygon_mesh(points, faces, surface);
  return CGAL::is_valid_polygon_mesh(surface) && surface.number_of_faces() == mesh.faces.size();
}

// Properties that must hold for any input.
void CheckRepair(const TriangleMesh& mesh) {
  Warnings warnings;
  const RepairedMesh out = Repaired(mesh, &warnings);
  EXPECT_EQ(warnings.empty(), out.defects.IsClean());
  EXPECT_TRUE(CgalSaysManifold(out.mesh));
  const StatusOr<MeshDefects> after = CheckMesh(out.mesh);
  ASSERT_TRUE(after.ok()) << after.status();
  EXPECT_TRUE(after->IsClean());

  // Each input face is in the result once, with its corners and label, or in removed_faces.
  ASSERT_EQ(out.face_in_input.size(), out.mesh.faces.size());
  ASSERT_EQ(out.vertex_in_input.size(), out.mesh.vertices.size());
  ASSERT_EQ(out.mesh.labels.size(), mesh.labels.empty() ? 0 : out.mesh.faces.size());
  std::set<int64_t> seen(out.removed_faces.begin(), out.removed_faces.end());
  EXPECT_EQ(seen.size(), out.removed_faces.size());
  EXPECT_TRUE(std::is_sorted(out.face_in_input.begin(), out.face_in_input.end()));
  for (size_t f = 0; f < out.mesh.faces.size(); ++f) {
    const auto input = static_cast<size_t>(out.face_in_input[f]);
    EXPECT_TRUE(seen.insert(out.face_in_input[f]).second);
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(out.vertex_in_input[out.mesh.faces[f][k]], mesh.faces[input][k]);
      EXPECT_EQ(out.mesh.Corner(f, k), mesh.Corner(input, k));
    }
    if (!mesh.labels.empty()) {
      EXPECT_EQ(out.mesh.labels[f], mesh.labels[input]);
    }
  }
  EXPECT_EQ(seen.size(), mesh.faces.size());
  double removed_area = 0;
  for (const int64_t face : out.removed_faces) removed_area += FaceArea(mesh, static_cast<size_t>(face));
  EXPECT_NEAR(Area(out.mesh) + removed_area, Area(mesh), 1e-9 * (1 + Area(mesh)));
  std::set<int64_t> used(out.vertex_in_input.begin(), out.vertex_in_input.end());
  EXPECT_EQ(static_cast<int64_t>(out.mesh.vertices.size() - used.size()), out.vertex_copies);

  // Repair is idempotent.
  Warnings again;
  const RepairedMesh twice = Repaired(out.mesh, &again);
  EXPECT_THAT(again, IsEmpty());
  EXPECT_EQ(twice.mesh.vertices, out.mesh.vertices);
  EXPECT_EQ(twice.mesh.faces, out.mesh.faces);
  EXPECT_EQ(twice.mesh.labels, out.mesh.labels);
  EXPECT_EQ(twice.vertex_copies, 0);
}

TEST(Repair, RandomMeshesBecomeManifold) {
  for (uint64_t seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE(seed);
    CheckRepair(Chaos(seed, 12, static_cast<int>(5 + seed)));
    CheckRepair(DamagedTorus(seed));
  }
}

TEST(Repair, CleanMeshesStayUnchanged) {
  for (const TriangleMesh& mesh : {TriangleMesh{}, Tetrahedron(), Grid(8, 5), Torus(9, 7)}) {
    CheckRepair(mesh);
    const RepairedMesh out = Repaired(mesh);
    EXPECT_TRUE(out.defects.IsClean());
    EXPECT_EQ(out.mesh.vertices, mesh.vertices);
    EXPECT_EQ(out.mesh.faces, mesh.faces);
  }
}

TEST(Repair, RemovesDegenerateFaces) {
  TriangleMesh mesh = Grid(3, 3);
  const auto vertex = static_cast<uint32_t>(mesh.vertices.size());
  mesh.vertices.push_back(0.5 * (mesh.vertices[0] + mesh.vertices[1]));
  mesh.faces.insert(mesh.faces.begin() + 2, {{4, 4, 5}, {0, 1, vertex}});
  mesh.faces.push_back({mesh.faces[0][1], mesh.faces[0][2], mesh.faces[0][0]});
  mesh.faces.push_back({mesh.faces[1][1], mesh.faces[1][0], mesh.faces[1][2]});
  mesh.labels.assign(mesh.faces.size(), 1);
  CheckRepair(mesh);
  Warnings warnings;
  const RepairedMesh out = Repaired(mesh, &warnings);
  EXPECT_THAT(out.removed_faces, ElementsAre(2, 3, 20, 21));
  EXPECT_THAT(warnings, ElementsAre("mesh: 1 faces with a repeated vertex removed (first: face 2)",
                                    "mesh: 1 faces with zero area removed (first: face 3)",
                                    "mesh: 2 duplicate faces removed (first: face 20)",
                                    "mesh: 1 unreferenced vertices removed (first: vertex 16)"));
}

TEST(Repair, CutsNonManifoldEdges) {
  TriangleMesh mesh = Grid(2, 1);
  const auto top = static_cast<uint32_t>(mesh.vertices.size());
  mesh.vertices.push_back({1, 0.5, 9});
  mesh.faces.push_back({1, 4, top});  // a fin on the middle edge
  CheckRepair(mesh);
  Warnings warnings;
  const RepairedMesh out = Repaired(mesh, &warnings);
  EXPECT_THAT(warnings, ElementsAre("mesh: 1 edges with more than two faces cut (first: at vertex 1)"));
  // Three surfaces now end at the edge, so both of its vertices have two copies.
  EXPECT_EQ(out.vertex_copies, 4);
  EXPECT_EQ(out.defects.non_manifold_vertices.count, 0);
}

TEST(Repair, SeparatesTouchingBodies) {
  // Two tetrahedra that share an edge: four faces there. Each is closed afterwards.
  TriangleMesh mesh = Tetrahedron();
  mesh.vertices.push_back({0, -1, 0});
  mesh.vertices.push_back({0, 0, -1});
  mesh.faces.insert(mesh.faces.end(), {{0, 4, 1}, {0, 1, 5}, {1, 4, 5}, {4, 0, 5}});
  CheckRepair(mesh);
  const RepairedMesh out = Repaired(mesh);
  EXPECT_EQ(out.defects.non_manifold_edges.count, 1);
  EXPECT_EQ(out.vertex_copies, 2);
  const StatusOr<MeshDefects> after = CheckMesh(out.mesh);
  ASSERT_TRUE(after.ok());
  EXPECT_EQ(after->boundary_edges, 0);
}

TEST(Repair, CutsNonManifoldVertices) {
  TriangleMesh mesh = Grid(2, 2);
  mesh.faces = {mesh.faces[0], mesh.faces[1], mesh.faces[6], mesh.faces[7]};
  CheckRepair(mesh);
  const RepairedMesh out = Repaired(mesh);
  EXPECT_EQ(out.defects.non_manifold_vertices.count, 1);
  EXPECT_EQ(out.defects.non_manifold_vertices.first, 4);
  EXPECT_EQ(out.defects.unreferenced_vertices.count, 2);
  EXPECT_THAT(out.vertex_in_input, ElementsAre(0, 1, 3, 4, 5, 7, 8, 4));
}

TEST(Repair, CutsAroundFlippedFaces) {
  TriangleMesh mesh = Torus(8, 8);
  std::swap(mesh.faces[40][0], mesh.faces[40][1]);
  CheckRepair(mesh);
  const RepairedMesh out = Repaired(mesh);
  EXPECT_EQ(out.defects.conflicting_edges.count, 3);
  EXPECT_EQ(out.defects.boundary_edges, 0);
  EXPECT_EQ(out.vertex_copies, 3);
  EXPECT_THAT(out.removed_faces, IsEmpty());
}

TEST(Repair, DoesNotDependOnThreads) {
  const TriangleMesh mesh = Chaos(1, 20000, 60000);
  const auto repaired = [&](int threads) {
    const ThreadLimit limit(threads);
    return Repaired(mesh);
  };
  const RepairedMesh one = repaired(1), two = repaired(2);
  EXPECT_EQ(one.mesh.vertices, two.mesh.vertices);
  EXPECT_EQ(one.mesh.faces, two.mesh.faces);
  EXPECT_EQ(one.removed_faces, two.removed_faces);
}

TEST(Repair, RejectsInvalidArrays) {
  TriangleMesh mesh = Tetrahedron();
  mesh.vertices[2].z() = std::numeric_limits<double>::infinity();
  EXPECT_THAT(CutMesh(mesh, nullptr).status().message(), HasSubstr("vertex 2 is not finite"));
  mesh = Tetrahedron();
  mesh.faces[1][1] = 4;
  EXPECT_THAT(CheckMesh(mesh).status().message(), HasSubstr("face 1 has vertex index 4, expected an index below 4"));
  mesh = Tetrahedron();
  mesh.labels = {1};
  EXPECT_THAT(CheckMesh(mesh).status().message(), HasSubstr("mesh has 1 labels, expected one per face: 4"));
}

TEST(MeshDefects, CountsBoundaryEdges) {
  const StatusOr<MeshDefects> defects = CheckMesh(Grid(4, 3));
  ASSERT_TRUE(defects.ok());
  EXPECT_EQ(defects->boundary_edges, 14);
  EXPECT_TRUE(defects->IsClean());
}

TEST(SelfIntersections, AreFound) {
  TriangleMesh mesh = Tetrahedron();
  EXPECT_EQ(SelfIntersections(mesh)->size(), 0u);
  // A second mesh, moved into the first.
  const TriangleMesh other = Tetrahedron({0.2, 0.2, -0.5});
  mesh.vertices.insert(mesh.vertices.end(), other.vertices.begin(), other.vertices.end());
  for (const Triangle& f : other.faces) mesh.faces.push_back({f[0] + 4, f[1] + 4, f[2] + 4});
  EXPECT_GT(SelfIntersections(mesh)->size(), 0u);
  const auto pairs = SelfIntersections(mesh).value();
  EXPECT_TRUE(std::is_sorted(pairs.begin(), pairs.end()));
  for (const auto& [a, b] : pairs) {
    EXPECT_LT(a, 4u) << "neither cuts itself";
    EXPECT_GE(b, 4u);
  }
  mesh.faces.push_back({0, 1, 5});
  EXPECT_EQ(SelfIntersections(mesh).status().code(), absl::StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace tessera
