#include "common/exporting/tiles3d/tiles3d_simplify.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <vector>

#include "common/base/random.h"
#include "common/exporting/tiles3d/tiles3d_border.h"
#include "common/exporting/tiles3d/tiles3d_part.h"
#include "common/geometry/nearest_surface.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

// A flat square of 2 `side` x `side` triangles with two classes.
Tiles3dMesh FlatTiles3d(int side) {
  Tiles3dMesh mesh;
  for (int y = 0; y <= side; ++y) {
    for (int x = 0; x <= side; ++x) mesh.vertices.positions.push_back({1.0 * x, 1.0 * y, 0});
  }
  mesh.vertices.normals.assign(mesh.vertices.positions.size(), Eigen::Vector3f::UnitZ());
  for (uint32_t y = 0; y < static_cast<uint32_t>(side); ++y) {
    for (uint32_t x = 0; x < static_cast<uint32_t>(side); ++x) {
      const uint32_t v = y * (side + 1) + x, up = v + side + 1;
      const int32_t label = x < static_cast<uint32_t>(side) / 2 ? 0 : 1;
      mesh.faces.Add({v, v + 1, up + 1}, label);
      mesh.faces.Add({v, up + 1, up}, label);
    }
  }
  return mesh;
}

double TileAreaOfLabel(const Tiles3dMesh& mesh, const Tiles3dFaces& faces, int32_t label) {
  double area = 0;
  for (size_t f = 0; f < faces.size(); ++f) {
    const auto& p = mesh.vertices.positions;
    const Triangle& t = faces.corners[f];
    if (faces.labels[f] == label) area += (p[t[1]] - p[t[0]]).cross(p[t[2]] - p[t[0]]).norm() / 2;
  }
  return area;
}

// Vertices on the side of a square.
std::vector<uint8_t> TileSides(const Tiles3dMesh& mesh) {
  return Tiles3dBorder(mesh.faces, mesh.vertices.positions.size());
}

double TileDistance(const std::vector<Eigen::Vector3d>& points, const Tiles3dVertices& vertices,
                    const Tiles3dFaces& faces) {
  const TriangleMesh mesh = {vertices.positions, faces.corners, {}};
  const NearestSurface surface(mesh);
  double distance_m = 0;
  for (const Eigen::Vector3d& p : points) distance_m = std::max(distance_m, surface.Find(p).distance_m);
  return distance_m;
}

// Edges with one face.
std::set<std::array<uint32_t, 2>> TileRims(const Tiles3dFaces& faces) {
  std::map<std::array<uint32_t, 2>, int> counts;
  for (const Triangle& face : faces.corners) {
    for (int k = 0; k < 3; ++k) ++counts[{std::min(face[k], face[(k + 1) % 3]), std::max(face[k], face[(k + 1) % 3])}];
  }
  std::set<std::array<uint32_t, 2>> rims;
  for (const auto& [edge, count] : counts) {
    if (count == 1) rims.insert(edge);
  }
  return rims;
}

TEST(SimplifyTiles3dTest, KeepsTheBordersOfClassesAndTheDistance) {
  const Tiles3dMesh mesh = FlatTiles3d(40);
  const Tiles3dLevel level = SimplifyTiles3d(mesh.vertices, mesh.faces, {0.5, 0, 100000, 100000}, TileSides(mesh));
  EXPECT_LE(level.faces.size(), 400u);  // of 3,200; 160 vertices are on the border
  EXPECT_NEAR(TileAreaOfLabel(mesh, level.faces, 0), 800, 1e-9);
  EXPECT_NEAR(TileAreaOfLabel(mesh, level.faces, 1), 800, 1e-9);
  EXPECT_LE(level.distance_m, 0.125);  // a face that is nearer than a quarter of the target need not be the nearest
  EXPECT_LT(TileDistance(mesh.vertices.positions, mesh.vertices, level.faces), 1e-9);
}

TEST(SimplifyTiles3dTest, GivesUpBordersOfClassesThatAreNoise) {
  Tiles3dMesh mesh = FlatTiles3d(60);
  Random random(1);
  for (int32_t& label : mesh.faces.labels) label = static_cast<int32_t>(random.Below(3));
  EXPECT_GT(SimplifyTiles3d(mesh.vertices, mesh.faces, {0.5, 0, 100000, 100000}, TileSides(mesh)).faces.size(), 5000u);
  const Tiles3dFaces simple = SimplifyTiles3d(mesh.vertices, mesh.faces, {0.5, 0, 700, 100000}, TileSides(mesh)).faces;
  EXPECT_LE(simple.size(), 700u + 240);  // 240 vertices are on the border
  for (int32_t label = 0; label < 3; ++label) EXPECT_GT(TileAreaOfLabel(mesh, simple, label), 300);
}

// A square of rough ground with masts of one vertex, 2 m high, some of them on a slope.
Tiles3dMesh RoughTiles3d(int side, uint64_t seed) {
  Tiles3dMesh mesh = FlatTiles3d(side);
  Random random(seed);
  for (Eigen::Vector3d& p : mesh.vertices.positions) {
    p.z() = random.Uniform(-0.05, 0.05) + (p.x() > side / 2.0 ? 0.3 * (p.x() - side / 2.0) : 0);
    if (random.Below(60) == 0) p.z() += 2;
    p = (p / kTiles3dGrid_m).array().round() * kTiles3dGrid_m;
  }
  return mesh;
}

TEST(SimplifyTiles3dTest, KeepsEachVertexWithinTheDistanceThatItTells) {
  for (const uint64_t seed : {1, 2, 3}) {
    const Tiles3dMesh mesh = RoughTiles3d(50, seed);
    size_t more = mesh.faces.size();
    for (const double distance_m : {0.06, 0.2, 0.5, 1.0}) {
      const Tiles3dLevel level =
          SimplifyTiles3d(mesh.vertices, mesh.faces, {distance_m, 0, 100000, 100000}, TileSides(mesh));
      EXPECT_LE(level.distance_m, distance_m);
      const double measured_m = TileDistance(mesh.vertices.positions, mesh.vertices, level.faces);
      EXPECT_LE(measured_m, level.distance_m + 1e-12);
      EXPECT_LT(level.faces.size(), more);
      more = level.faces.size();
    }
    // The masts stay, which means over areas would not notice.
    EXPECT_LT(more, mesh.faces.size() / 3);
  }
}

TEST(SimplifyTiles3dTest, KeepsTheTopologyAndTheBorder) {
  const Tiles3dMesh mesh = RoughTiles3d(30, 4);
  const Tiles3dFaces simple = SimplifyTiles3d(mesh.vertices, mesh.faces, {3, 0, 100000, 100000}, TileSides(mesh)).faces;
  EXPECT_EQ(TileRims(simple), TileRims(mesh.faces));
  std::map<std::array<uint32_t, 2>, int> edges;
  std::set<uint32_t> vertices;
  for (const Triangle& face : simple.corners) {
    for (int k = 0; k < 3; ++k) {
      const uint32_t a = face[k], b = face[(k + 1) % 3];
      ++edges[{std::min(a, b), std::max(a, b)}];
      vertices.insert(a);
    }
  }
  for (const auto& [edge, count] : edges) EXPECT_LE(count, 2);
  EXPECT_EQ(static_cast<int>(vertices.size() + simple.size()) - static_cast<int>(edges.size()), 1);  // a disk
}

TEST(SimplifyTiles3dTest, EndsWithTheFacesThatPicturesNeed) {
  const Tiles3dMesh mesh = FlatTiles3d(40);
  const size_t size = SimplifyTiles3d(mesh.vertices, mesh.faces, {5, 1000, 2000, 2000}, TileSides(mesh)).faces.size();
  EXPECT_NEAR(static_cast<double>(size), 1000 + 160, 2);
}

TEST(SimplifyTiles3dTest, GoesFartherIfTooManyFacesAreLeft) {
  const Tiles3dMesh mesh = RoughTiles3d(50, 5);
  const Tiles3dLevel level = SimplifyTiles3d(mesh.vertices, mesh.faces, {0.01, 0, 1000, 1000}, TileSides(mesh));
  EXPECT_LE(level.faces.size(), 1000u + 200);  // 200 vertices are on the border
  EXPECT_GT(level.faces.size(), 900u);
  EXPECT_GT(level.distance_m, 0.01);
}

TEST(SimplifyTiles3dTest, SimplifiesRimsThatNoOtherTileHas) {
  Tiles3dMesh mesh = FlatTiles3d(40);
  Tiles3dFaces with_holes;
  for (uint32_t f = 0; f < mesh.faces.size(); ++f) {
    if (f / 2 % 7 != 3) with_holes.Add(mesh.faces.corners[f], 0);
  }
  std::vector<uint8_t> fixed(mesh.vertices.positions.size(), 0);
  for (uint32_t v = 0; v <= 40; ++v) fixed[v] = 1;  // one side
  const Tiles3dLevel level = SimplifyTiles3d(mesh.vertices, with_holes, {1, 0, 500, 100000}, fixed);
  EXPECT_LE(level.faces.size(), 541u);  // of 2,744
  EXPECT_LE(level.distance_m, 1);
  // Edges between fixed vertices have a face.
  const std::set<std::array<uint32_t, 2>> before = TileRims(with_holes), after = TileRims(level.faces);
  int common = 0;
  for (const auto& edge : before) {
    if (!fixed[edge[0]] || !fixed[edge[1]]) continue;
    ++common;
    EXPECT_TRUE(after.contains(edge)) << edge[0];
  }
  EXPECT_GT(common, 30);
}

// The square of FlatTiles3d(20) with rough heights, and edges of its side y = 0 that another tile has.
struct ThinnedTile {
  Tiles3dMesh mesh = FlatTiles3d(20);
  std::vector<std::vector<Tiles3dEdge>> others;

  explicit ThinnedTile(double roughness_m) {
    Random random(6);
    for (Eigen::Vector3d& p : mesh.vertices.positions) p.z() = random.Uniform(-roughness_m, roughness_m);
    mesh.vertices.shared = TileSides(mesh);
  }
  // Another tile that has the edges from x = `first` to `last`.
  void AddOther(int first, int last) {
    std::vector<Tiles3dEdge>& edges = others.emplace_back();
    const std::vector<Eigen::Vector3d>& p = mesh.vertices.positions;
    for (int x = first; x < last; ++x) edges.push_back({p[x + 1], p[x]});
  }
  Tiles3dFaces Thin(double tolerance_m, double free_m) {
    std::vector<uint32_t> source;
    Tiles3dFaces thinned = ThinTiles3dBorder(mesh.faces, others, tolerance_m, free_m, &mesh.vertices, &source);
    EXPECT_EQ(source.size(), thinned.size());
    for (size_t f = 0; f < thinned.size(); ++f) EXPECT_EQ(thinned.labels[f], mesh.faces.labels[source[f]]);
    return thinned;
  }
  std::vector<uint32_t> Shared() const {
    std::vector<uint32_t> shared;
    for (uint32_t v = 0; v < mesh.vertices.shared.size(); ++v) {
      if (mesh.vertices.shared[v]) shared.push_back(v);
    }
    return shared;
  }
};

TEST(ThinTiles3dBorderTest, KeepsVerticesWhereTilesMeetAndTheArea) {
  ThinnedTile tile(0);
  tile.AddOther(0, 7);
  tile.AddOther(7, 20);
  const Tiles3dFaces thinned = tile.Thin(0.1, 0.1);
  EXPECT_EQ(tile.Shared(), (std::vector<uint32_t>{0, 7, 20}));
  EXPECT_TRUE(TileRims(thinned).contains({0, 7}));
  EXPECT_TRUE(TileRims(thinned).contains({7, 20}));
  EXPECT_DOUBLE_EQ(TileAreaOfLabel(tile.mesh, thinned, 0) + TileAreaOfLabel(tile.mesh, thinned, 1), 400);
}

TEST(ThinTiles3dBorderTest, LeavesRimsThatNoOtherTileHas) {
  ThinnedTile tile(0.2);
  tile.AddOther(0, 20);
  const Tiles3dFaces thinned = tile.Thin(0.01, 0.1);
  EXPECT_GT(tile.Shared().size(), 15u);
  EXPECT_LE(tile.Shared().back(), 20u);
  int rims = 0;
  for (const auto& edge : TileRims(thinned)) rims += edge[1] > 20 ? 1 : 0;
  EXPECT_EQ(rims, 60);
}

TEST(ThinTiles3dBorderTest, ShrinksShortBordersBetweenHolesToAPoint) {
  ThinnedTile tile(0);
  tile.AddOther(3, 5);
  tile.AddOther(10, 15);
  tile.Thin(0.1, 2.5);
  EXPECT_EQ(tile.Shared(), (std::vector<uint32_t>{10, 15}));
}

TEST(Tiles3dPartTest, IsReadAsItWasWrittenAndRefusedIfItIsDamaged) {
  const TempFolder folder = *TempFolder::Create(testing::TempDir());
  const std::string path = folder.path() + "/part";
  Tiles3dPart part = {"start", FlatTiles3d(3),   {Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(3, 3, 1)},
                      0.75,    {{{1, 2, 3}, 5}}, 0.5};
  part.mesh.vertices.shared.assign(16, 1);
  part.mesh.vertices.colors.assign(16, Rgb{1, 2, 3});
  ASSERT_TRUE(WriteTiles3dParts(path, {part}).ok());
  const StatusOr<Tiles3dPart> read = ReadTiles3dPart(path, "start");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->mesh.vertices.positions, part.mesh.vertices.positions);
  EXPECT_EQ(read->mesh.vertices.normals, part.mesh.vertices.normals);
  EXPECT_EQ(read->mesh.vertices.colors, part.mesh.vertices.colors);
  EXPECT_EQ(read->mesh.faces.corners, part.mesh.faces.corners);
  EXPECT_EQ(read->mesh.faces.labels, part.mesh.faces.labels);
  EXPECT_EQ(read->error_m, 0.75);
  EXPECT_EQ(read->mesh.vertices.shared, part.mesh.vertices.shared);
  ASSERT_EQ(read->samples.size(), 1u);
  EXPECT_EQ(read->samples[0].position, part.samples[0].position);
  EXPECT_EQ(read->samples[0].face, 5u);
  EXPECT_EQ(read->samples_error_m, 0.5);
  EXPECT_EQ(read->box.max(), part.box.max());
  EXPECT_EQ(ReadTiles3dPart(path, "result")->mesh.faces.size(), 0u);
  part.mesh.faces.corners[0][0] = 16;
  ASSERT_TRUE(WriteTiles3dParts(path, {part}).ok());
  EXPECT_EQ(ReadTiles3dPart(path, "start").status().code(), absl::StatusCode::kDataLoss);
  part.mesh.faces.corners[0][0] = 0;
  part.samples[0].face = 18;
  ASSERT_TRUE(WriteTiles3dParts(path, {part}).ok());
  EXPECT_EQ(ReadTiles3dPart(path, "start").status().code(), absl::StatusCode::kDataLoss);
  part.samples[0].face = 5;
  part.mesh.vertices.normals.pop_back();
  ASSERT_TRUE(WriteTiles3dParts(path, {part}).ok());
  EXPECT_EQ(ReadTiles3dPart(path, "start").status().code(), absl::StatusCode::kDataLoss);
}

}  // namespace
}  // namespace tessera
