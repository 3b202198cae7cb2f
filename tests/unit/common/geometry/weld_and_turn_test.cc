// Repairs that connect and turn faces: soups, tiles, mixed orientations, stray vertices.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "common/base/parallel.h"
#include "common/geometry/repair.h"
#include "tests/support/bent_meshes.h"
#include "tests/unit/common/geometry/meshes.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

RepairedMesh RepairedWith(const TriangleMesh& mesh, const RepairOptions& options, Warnings* warnings = nullptr) {
  StatusOr<RepairedMesh> repaired = RepairMesh(mesh, options, warnings);
  EXPECT_TRUE(repaired.ok()) << repaired.status();
  return *std::move(repaired);
}

// Positions of the faces' corners.
std::vector<std::array<Eigen::Vector3d, 3>> Corners(const TriangleMesh& mesh) {
  std::vector<std::array<Eigen::Vector3d, 3>> out;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    out.push_back({mesh.Corner(f, 0), mesh.Corner(f, 1), mesh.Corner(f, 2)});
  }
  return out;
}

void ExpectTwiceEqualsOnce(const TriangleMesh& mesh, const RepairOptions& options) {
  const RepairedMesh once = RepairedWith(mesh, options);
  const RepairedMesh twice = RepairedWith(once.mesh, options);
  EXPECT_EQ(twice.mesh.vertices, once.mesh.vertices);
  EXPECT_EQ(twice.mesh.faces, once.mesh.faces);
  EXPECT_EQ(twice.mesh.labels, once.mesh.labels);
  EXPECT_TRUE(twice.defects.IsClean());
}

TEST(WeldAndTurn, LeavesCleanMeshesAsTheyAre) {
  for (const TriangleMesh& mesh : {TriangleMesh{}, Tetrahedron(), Grid(8, 5), Torus(9, 7)}) {
    for (const RepairOptions& options : {RepairOptions(), ViewsAround(mesh)}) {
      Warnings warnings;
      const RepairedMesh out = RepairedWith(mesh, options, &warnings);
      EXPECT_THAT(warnings, IsEmpty());
      EXPECT_EQ(out.mesh.vertices, mesh.vertices);
      EXPECT_EQ(out.mesh.faces, mesh.faces);
    }
  }
}

TEST(WeldAndTurn, ConnectsASoup) {
  for (const TriangleMesh& mesh : {Grid(8, 5), Torus(9, 7)}) {
    Warnings warnings;
    const RepairedMesh out = RepairedWith(Soup(mesh), ViewsAround(mesh), &warnings);
    EXPECT_EQ(out.mesh.vertices.size(), mesh.vertices.size());
    EXPECT_EQ(Corners(out.mesh), Corners(mesh));
    EXPECT_EQ(CheckMesh(out.mesh)->boundary_edges, CheckMesh(mesh)->boundary_edges);
    EXPECT_THAT(warnings, ElementsAre(HasSubstr("vertices on borders at the same place welded (first: vertex 3)")));
    EXPECT_EQ(out.defects.unreferenced_vertices.count, 0);
    ExpectTwiceEqualsOnce(Soup(mesh), ViewsAround(mesh));
  }
}

TEST(WeldAndTurn, ConnectsTilesWithRoundedBorders) {
  const TriangleMesh mesh = Torus(24, 16);
  TriangleMesh tiles = Tiles(mesh, 3);
  EXPECT_GT(tiles.vertices.size(), mesh.vertices.size());
  for (Eigen::Vector3d& p : tiles.vertices) p = p.cast<float>().cast<double>();
  for (size_t v = 0; v < tiles.vertices.size(); v += 2) {
    tiles.vertices[v].x() = std::nextafter(static_cast<float>(tiles.vertices[v].x()), 9.0f);
  }
  const RepairedMesh out = RepairedWith(tiles, RepairOptions());
  EXPECT_EQ(out.mesh.vertices.size(), mesh.vertices.size());
  EXPECT_EQ(CheckMesh(out.mesh)->boundary_edges, 0);
  ExpectTwiceEqualsOnce(tiles, RepairOptions());
}

TEST(WeldAndTurn, DoesNotWeldBordersThatAreApart) {
  TriangleMesh tiles = Tiles(Grid(6, 6), 2);
  const size_t vertices = tiles.vertices.size();
  for (size_t v = vertices / 2; v < vertices; ++v) tiles.vertices[v].z() += 0.01;  // a step at the border
  EXPECT_EQ(RepairedWith(tiles, RepairOptions()).mesh.vertices.size(), vertices);
}

TEST(WeldAndTurn, DoesNotWeldWhereMoreThanTwoBordersMeet) {
  TriangleMesh mesh;
  for (const double z : {-1.0, 0.5, 2.0}) {  // three faces, each with its own copy of one edge
    const auto v = static_cast<uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), {{0, 0, 0}, {0, 1, 0}, {1, 0, z}});
    mesh.faces.push_back({v, v + 1, v + 2});
  }
  const RepairedMesh out = RepairedWith(mesh, RepairOptions());
  EXPECT_EQ(out.defects.welded_vertices.count, 0);
  EXPECT_EQ(out.mesh.faces, mesh.faces);
}

TEST(WeldAndTurn, KeepsBothSidesOfASheet) {
  TriangleMesh mesh = Grid(3, 2);
  const size_t faces = mesh.faces.size();
  const auto vertices = static_cast<uint32_t>(mesh.vertices.size());
  for (uint32_t v = 0; v < vertices; ++v) mesh.vertices.push_back(mesh.vertices[v]);
  for (size_t f = 0; f < faces; ++f) {
    const Triangle& face = mesh.faces[f];
    mesh.faces.push_back({face[0] + vertices, face[2] + vertices, face[1] + vertices});
  }
  const RepairedMesh out = RepairedWith(mesh, RepairOptions());
  EXPECT_EQ(out.mesh.faces, mesh.faces);
}

TEST(WeldAndTurn, CopiesOfVerticesThatCuttingMadeStay) {
  // Two tetrahedra that share an edge: cut there. A second repair finds the copies, and does not weld them.
  TriangleMesh mesh = Tetrahedron();
  mesh.vertices.push_back({0, -1, 0});
  mesh.vertices.push_back({0, 0, -1});
  mesh.faces.insert(mesh.faces.end(), {{0, 4, 1}, {0, 1, 5}, {1, 4, 5}, {4, 0, 5}});
  ExpectTwiceEqualsOnce(mesh, RepairOptions());
  for (uint64_t seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE(seed);
    ExpectTwiceEqualsOnce(DamagedTorus(seed), RepairOptions());
  }
}

TEST(WeldAndTurn, TurnsAMeshThatIsInsideOut) {
  const TriangleMesh mesh = Torus(24, 16);
  TriangleMesh inside_out = mesh;
  for (Triangle& face : inside_out.faces) std::swap(face[1], face[2]);
  Warnings warnings;
  const RepairedMesh out = RepairedWith(inside_out, ViewsAround(mesh), &warnings);
  EXPECT_EQ(out.mesh.faces, mesh.faces);
  EXPECT_THAT(warnings, ElementsAre("mesh: 768 faces turned: they faced inwards or against their neighbours (first: "
                                    "face 0)"));
  // Without views nothing says which side is outside.
  EXPECT_EQ(RepairedWith(inside_out, RepairOptions()).mesh.faces, inside_out.faces);
}

TEST(WeldAndTurn, TheViewsDecideAgainstTheMajority) {
  const TriangleMesh mesh = Torus(24, 16);
  TriangleMesh turned = mesh;
  for (size_t f = 0; f < turned.faces.size(); ++f) {
    if (f % 4 != 0) std::swap(turned.faces[f][1], turned.faces[f][2]);
  }
  EXPECT_EQ(RepairedWith(turned, ViewsAround(mesh)).mesh.faces, mesh.faces);
  EXPECT_EQ(RepairedWith(turned, ViewsAround(mesh)).defects.turned_faces.count, 576);
  EXPECT_EQ(RepairedWith(turned, RepairOptions()).defects.turned_faces.count, 192);
  // Also if the faces are not connected.
  EXPECT_EQ(Corners(RepairedWith(Soup(turned), ViewsAround(mesh)).mesh), Corners(mesh));
}

TEST(WeldAndTurn, CutsWhatCannotBeOriented) {
  const TriangleMesh strip = MoebiusStrip(12);
  const RepairedMesh out = RepairedWith(strip, RepairOptions());
  EXPECT_EQ(out.defects.conflicting_edges.count, 1);
  ExpectTwiceEqualsOnce(strip, RepairOptions());
  ExpectTwiceEqualsOnce(Soup(strip), RepairOptions());
}

TEST(WeldAndTurn, RemovesAVertexAtTheOriginOfTheFile) {
  TriangleMesh mesh = Grid(12, 12);
  RepairOptions options = ViewsAround(mesh);
  options.file_origin = {-386512, -6671850, -20};
  mesh.vertices[40] = options.file_origin;
  Warnings warnings;
  const RepairedMesh out = RepairedWith(mesh, options, &warnings);
  EXPECT_EQ(out.defects.stray_vertices.count, 1);
  EXPECT_EQ(out.mesh.faces.size(), mesh.faces.size() - 6);
  EXPECT_THAT(warnings, ElementsAre("mesh: 1 vertices far from all that the images show removed, with 6 faces (first: "
                                    "vertex 40)"));
  for (const Eigen::Vector3d& p : out.mesh.vertices) EXPECT_LT(p.norm(), 100);
  ExpectTwiceEqualsOnce(mesh, options);
  // Near the mesh it is a vertex like others.
  options.file_origin = mesh.vertices[41];
  EXPECT_EQ(RepairedWith(Grid(12, 12), options).mesh.faces, Grid(12, 12).faces);
}

TEST(WeldAndTurn, RemovesASpike) {
  TriangleMesh mesh = Grid(12, 12);
  const RepairOptions options = ViewsAround(mesh);
  mesh.vertices[40].z() += 300;
  EXPECT_EQ(RepairedWith(mesh, options).mesh.faces.size(), mesh.faces.size() - 6);
  mesh.vertices[40].z() -= 280;  // a tower, as far as the views
  EXPECT_EQ(RepairedWith(mesh, options).mesh.faces, mesh.faces);
}

TEST(WeldAndTurn, KeepsLargeFacesAroundTheScene) {
  TriangleMesh mesh = Grid(12, 12);
  const RepairOptions options = ViewsAround(mesh);
  const auto first = static_cast<uint32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), {{-400, -400, -2}, {400, -400, -2}, {400, 400, -2}, {-400, 400, -2}});
  mesh.faces.insert(mesh.faces.end(), {{first, first + 1, first + 2}, {first, first + 2, first + 3}});
  EXPECT_EQ(RepairedWith(mesh, options).mesh.faces, mesh.faces);
}

TEST(WeldAndTurn, RefusesAMeshThatIsMostlyStray) {
  TriangleMesh mesh = Grid(12, 12);
  const RepairOptions options = ViewsAround(mesh);
  for (size_t v = 0; v < mesh.vertices.size(); v += 4) mesh.vertices[v].x() += 1e6;
  EXPECT_THAT(RepairMesh(mesh, options, nullptr).status().message(),
              HasSubstr("of 288 faces with a vertex far from all that the images show (first: vertex 0), expected at "
                        "most 10 %: check the mesh's unit, origin and extent"));
}

TEST(WeldAndTurn, CountsPiecesThatTheViewsHardlyShow) {
  TriangleMesh mesh = Grid(12, 12);
  const RepairOptions options = ViewsAround(mesh);
  const auto add = [&](const Eigen::Vector3d& at, double size) {
    const auto v = static_cast<uint32_t>(mesh.vertices.size());
    for (const Eigen::Vector3d& p : {Eigen::Vector3d(0, 0, 0), {1, 0, 0}, {0, 1, 0}}) {
      mesh.vertices.push_back(at + size * p);
    }
    mesh.faces.push_back({v, v + 1, v + 2});
  };
  add({4, 4, 3}, 1);
  EXPECT_EQ(RepairedWith(mesh, options).defects.small_pieces.count, 0);
  add({7, 7, 3}, 0.001);  // too small
  add({5, 5, -9}, 1);     // hidden
  const RepairedMesh out = RepairedWith(mesh, options);
  EXPECT_EQ(out.defects.small_pieces.count, 2);
  EXPECT_EQ(out.defects.small_pieces.first, 289);
  EXPECT_EQ(out.mesh.faces, mesh.faces);
}

TEST(WeldAndTurn, DoesNotDependOnThreads) {
  TriangleMesh mesh = Torus(60, 40);
  for (size_t f = 0; f < mesh.faces.size(); f += 3) std::swap(mesh.faces[f][1], mesh.faces[f][2]);
  mesh = Soup(mesh);
  const auto repaired = [&](int threads) {
    const ThreadLimit limit(threads);
    return RepairedWith(mesh, ViewsAround(mesh));
  };
  const RepairedMesh one = repaired(1), two = repaired(2);
  EXPECT_EQ(one.mesh.vertices, two.mesh.vertices);
  EXPECT_EQ(one.mesh.faces, two.mesh.faces);
}

}  // namespace
}  // namespace tessera
