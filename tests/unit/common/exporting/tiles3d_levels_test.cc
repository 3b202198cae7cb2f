#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "common/exporting/export_map.h"
#include "common/exporting/tiles3d/tiles3d_border.h"
#include "common/exporting/tiles3d/tiles3d_mesh.h"
#include "common/exporting/tiles3d/tiles3d_part.h"
#include "common/exporting/tiles3d/tiles3d_simplify.h"
#include "common/geometry/nearest_surface.h"
#include "tests/unit/common/exporting/tiles3d_reader.h"

namespace tessera {
namespace {

using TilePlace = std::array<double, 3>;  // compared bit for bit: there is no -0 and no NaN
using TilePlaceEdges = std::map<std::array<TilePlace, 2>, int>;
using TilePlaceFace = std::array<TilePlace, 3>;

TilePlace TilePlaceOf(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

// Directed edges without their opposites: the border of the mesh.
TilePlaceEdges TileBorderEdges(const std::vector<TilePlaceFace>& faces) {
  TilePlaceEdges edges;
  const auto add = [&](const TilePlace& a, const TilePlace& b, int count) {
    const auto it = edges.try_emplace({a, b}, 0).first;
    if ((it->second += count) == 0) edges.erase(it);
  };
  for (const TilePlaceFace& face : faces) {
    for (int k = 0; k < 3; ++k) {
      const TilePlace &a = face[k], &b = face[(k + 1) % 3];
      a < b ? add(a, b, 1) : add(b, a, -1);
    }
  }
  return edges;
}

std::vector<TilePlaceFace> TileFacesOf(const TriangleMesh& mesh) {
  std::vector<TilePlaceFace> faces;
  for (const Triangle& f : mesh.faces) {
    TilePlaceFace face = {TilePlaceOf(mesh.vertices[f[0]]), TilePlaceOf(mesh.vertices[f[1]]),
                          TilePlaceOf(mesh.vertices[f[2]])};
    std::rotate(face.begin(), std::min_element(face.begin(), face.end()), face.end());
    faces.push_back(face);
  }
  return faces;
}

// Calls check(tile, its mesh, all leaf meshes below it) for every tile, and returns the leaf meshes.
template <class Check>
std::vector<TriangleMesh> VisitTiles(const ReadTile& tile, const Check& check) {
  const TriangleMesh mesh = ParseTiles3dGlb(*ReadFile(tile.path)).mesh;
  std::vector<TriangleMesh> leaves;
  if (tile.is_leaf) leaves.push_back(mesh);
  for (const ReadTile& child : tile.children) {
    for (TriangleMesh& leaf : VisitTiles(child, check)) leaves.push_back(std::move(leaf));
  }
  check(tile, mesh, leaves);
  return leaves;
}

// Of a tile above the sheets, from its name; 0: of a sheet.
int TileLevelOf(const ReadTile& tile) {
  const size_t at = tile.path.find("/upper/");
  return at == std::string::npos ? 0 : std::stoi(tile.path.substr(at + 7));
}

double TileDistanceToEdges(const TilePlace& place, const TilePlaceEdges& edges) {
  const auto vector = [](const TilePlace& p) { return Eigen::Vector3d(p[0], p[1], p[2]); };
  const Eigen::Vector3d p = vector(place);
  double nearest_m = 1e9;
  for (const auto& [edge, count] : edges) {
    const Eigen::Vector3d a = vector(edge[0]), ab = vector(edge[1]) - a;
    const double t = std::clamp((p - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0);
    nearest_m = std::min(nearest_m, (p - a - t * ab).norm());
  }
  return nearest_m;
}

TEST(Tiles3dLevelsTest, HaveNoCracksBetweenTilesOfOneLevelNorInSheets) {
  for (const uint64_t seed : {1, 2, 3}) {
    ExportedTerrain terrain(90, seed);
    terrain.sizes.border_tolerance = 0.005;
    terrain.Write();
    int inner = 0;
    std::map<int, TilePlaceEdges> sums;  // of the border edges of all tiles of a level above the sheets
    TilePlaceEdges outer;
    VisitTiles(ReadTiles3d(terrain.path("result")),
               [&](const ReadTile& tile, const TriangleMesh& mesh, const std::vector<TriangleMesh>& leaves) {
                 std::vector<TilePlaceFace> finest;
                 for (const TriangleMesh& leaf : leaves) {
                   const std::vector<TilePlaceFace> faces = TileFacesOf(leaf);
                   finest.insert(finest.end(), faces.begin(), faces.end());
                 }
                 outer = TileBorderEdges(finest);
                 const TilePlaceEdges edges = TileBorderEdges(TileFacesOf(mesh));
                 if (!tile.is_leaf) ++inner;
                 const int level = TileLevelOf(tile);
                 // Every tile of a sheet ends in the same edges as the finest tiles below it, so any two fit together.
                 if (level == 0) {
                   EXPECT_TRUE(edges == outer) << tile.path;
                   return;
                 }
                 EXPECT_LT(edges.size(), 0.8 * static_cast<double>(outer.size())) << tile.path;
                 for (const auto& [edge, count] : edges) {
                   if ((sums[level][edge] += count) == 0) sums[level].erase(edge);
                 }
               });
    EXPECT_GT(inner, 8);
    ASSERT_EQ(sums.size(), 2u);
    std::set<TilePlace> outer_places;
    for (const auto& [edge, count] : outer) outer_places.insert({edge[0], edge[1]});
    for (const auto& [level, edges] : sums) {
      for (const auto& [edge, count] : edges) {
        EXPECT_TRUE(outer_places.contains(edge[0]) && outer_places.contains(edge[1])) << level;
      }
    }
  }
}

TEST(Tiles3dLevelsTest, HaveGapsToFinerLevelsOfAnEighthOfTheirErrorAtMost) {
  ExportedTerrain terrain(90, 7);
  terrain.sizes.border_tolerance = 0.005;
  terrain.Write();
  struct Border {
    double error_m;
    TriangleMesh mesh;
    std::set<TilePlace> finest;
  };
  std::map<int, std::vector<Border>> levels;
  VisitTiles(ReadTiles3d(terrain.path("result")),
             [&](const ReadTile& tile, const TriangleMesh& mesh, const std::vector<TriangleMesh>& leaves) {
               if (TileLevelOf(tile) == 0) return;
               std::vector<TilePlaceFace> finest;
               for (const TriangleMesh& leaf : leaves) {
                 const std::vector<TilePlaceFace> faces = TileFacesOf(leaf);
                 finest.insert(finest.end(), faces.begin(), faces.end());
               }
               Border& border = levels[TileLevelOf(tile)].emplace_back(Border{tile.error_m, mesh, {}});
               for (const auto& [edge, count] : TileBorderEdges(finest)) border.finest.insert({edge[0], edge[1]});
             });
  // What neighbours see of a tile: the vertices that the finest tiles on both sides of the border have.
  double largest = 0;
  for (const Border& a : levels[1]) {
    const NearestSurface surface(a.mesh);
    for (const Border& b : levels[1]) {
      if (&a == &b) continue;
      for (const TilePlace& place : b.finest) {
        if (!a.finest.contains(place)) continue;
        const double gap_m = surface.Find({place[0], place[1], place[2]}).distance_m;
        largest = std::max(largest, gap_m / a.error_m);
      }
    }
  }
  EXPECT_LE(largest, 1 / kTiles3dGapsInError);
  EXPECT_GT(largest, 0.02);
}

TEST(Tiles3dLevelsTest, HaveEachFaceInOneLeafWithItsClass) {
  ExportedTerrain terrain(70, 4);
  terrain.Write();
  const StatusOr<GlobeMap> globe = GlobeMap::Open(terrain.scene);
  std::multiset<std::pair<TilePlaceFace, int32_t>> expected, found;
  for (const auto& [id, sheet] : terrain.sheets) {
    TriangleMesh mesh = {sheet.vertices, sheet.faces, {}};
    ASSERT_TRUE(globe->EnuFromLocal(mesh.vertices).ok());
    for (Eigen::Vector3d& p : mesh.vertices) p = (p * 4096).array().round() / 4096 + 0.0;
    const std::vector<TilePlaceFace> faces = TileFacesOf(mesh);
    for (size_t f = 0; f < faces.size(); ++f) {
      const int32_t label = sheet.labels[f];
      expected.insert({faces[f], label >= 0 && label < 4 ? label : 4});
    }
  }
  VisitTiles(ReadTiles3d(terrain.path("result")), [&](const ReadTile& tile, const TriangleMesh& mesh, const auto&) {
    if (!tile.is_leaf) return;
    EXPECT_LE(mesh.faces.size(), terrain.sizes.leaf_faces);
    const std::vector<TilePlaceFace> faces = TileFacesOf(mesh);
    for (size_t f = 0; f < faces.size(); ++f) found.insert({faces[f], mesh.labels[f]});
  });
  EXPECT_EQ(found, expected);
}

TEST(Tiles3dLevelsTest, HaveErrorsThatAreNoLessThanTheDistancesOfTheFinestVertices) {
  ExportedTerrain terrain(90, 5);
  terrain.Write();
  VisitTiles(ReadTiles3d(terrain.path("result")),
             [&](const ReadTile& tile, const TriangleMesh& mesh, const std::vector<TriangleMesh>& leaves) {
               if (tile.is_leaf) {
                 EXPECT_EQ(tile.error_m, 0);
                 return;
               }
               const NearestSurface surface(mesh);
               double distance_m = 0;
               for (const TriangleMesh& leaf : leaves) {
                 for (const Eigen::Vector3d& p : leaf.vertices)
                   distance_m = std::max(distance_m, surface.Find(p).distance_m);
               }
               EXPECT_GE(tile.error_m, distance_m - 1e-12) << tile.path;
               // Not more than what the side permits, and what is lost at the border; a sheet has 16 m.
               const double side_m = std::ldexp(16, TileLevelOf(tile));
               EXPECT_LE(tile.error_m, 1.5 * terrain.sizes.error * side_m) << tile.path;
               for (const ReadTile& child : tile.children) EXPECT_GT(tile.error_m, child.error_m);
             });
}

TEST(Tiles3dLevelsTest, LieInTheBoxesOfTheirParents) {
  ExportedTerrain terrain(60, 6);
  terrain.Write();
  VisitTiles(ReadTiles3d(terrain.path("result")), [&](const ReadTile& tile, const TriangleMesh& mesh, const auto&) {
    const Eigen::AlignedBox3d box(tile.box.min().array() - 1e-9, tile.box.max().array() + 1e-9);
    for (const ReadTile& child : tile.children) EXPECT_TRUE(box.contains(child.box));
    EXPECT_TRUE(
        std::all_of(mesh.vertices.begin(), mesh.vertices.end(), [&](const auto& p) { return box.contains(p); }));
  });
}

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

TEST(SimplifyTiles3dTest, KeepsTheBordersOfClassesAndTheDistance) {
  const Tiles3dMesh mesh = FlatTiles3d(40);
  const Tiles3dLevel level = SimplifyTiles3d(mesh.vertices, mesh.faces, {0.5, 0, 100000, 100000});
  EXPECT_LE(level.faces.size(), 400u);  // of 3,200; 160 vertices are on the border
  EXPECT_NEAR(TileAreaOfLabel(mesh, level.faces, 0), 800, 1e-9);
  EXPECT_NEAR(TileAreaOfLabel(mesh, level.faces, 1), 800, 1e-9);
  EXPECT_LE(level.distance_m, 0.125);  // a face that is nearer than a quarter of the target need not be the nearest
  EXPECT_LT(Tiles3dDistance(mesh.vertices.positions, mesh.vertices, level.faces), 1e-9);
}

TEST(SimplifyTiles3dTest, GivesUpBordersOfClassesThatAreNoise) {
  Tiles3dMesh mesh = FlatTiles3d(60);
  Random random(1);
  for (int32_t& label : mesh.faces.labels) label = static_cast<int32_t>(random.Below(3));
  EXPECT_GT(SimplifyTiles3d(mesh.vertices, mesh.faces, {0.5, 0, 100000, 100000}).faces.size(), 5000u);
  const Tiles3dFaces simple = SimplifyTiles3d(mesh.vertices, mesh.faces, {0.5, 0, 700, 100000}).faces;
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
      const Tiles3dLevel level = SimplifyTiles3d(mesh.vertices, mesh.faces, {distance_m, 0, 100000, 100000});
      EXPECT_LE(level.distance_m, distance_m);
      const double measured_m = Tiles3dDistance(mesh.vertices.positions, mesh.vertices, level.faces);
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
  const Tiles3dFaces simple = SimplifyTiles3d(mesh.vertices, mesh.faces, {3, 0, 100000, 100000}).faces;
  EXPECT_EQ(Tiles3dBorderEdges(simple, mesh.vertices.positions.size()),
            Tiles3dBorderEdges(mesh.faces, mesh.vertices.positions.size()));
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
  const size_t size = SimplifyTiles3d(mesh.vertices, mesh.faces, {5, 1000, 2000, 2000}).faces.size();
  EXPECT_NEAR(static_cast<double>(size), 1000 + 160, 2);
}

TEST(SimplifyTiles3dTest, GoesFartherIfTooManyFacesAreLeft) {
  const Tiles3dMesh mesh = RoughTiles3d(50, 5);
  const Tiles3dLevel level = SimplifyTiles3d(mesh.vertices, mesh.faces, {0.01, 0, 1000, 1000});
  EXPECT_LE(level.faces.size(), 1000u + 200);  // 200 vertices are on the border
  EXPECT_GT(level.faces.size(), 900u);
  EXPECT_GT(level.distance_m, 0.01);
}

TEST(SimplifyTiles3dTest, MeasuresTheDistanceOfAVertexThatIsLeftOut) {
  Tiles3dMesh mesh = FlatTiles3d(2);
  mesh.vertices.positions[4].z() = 0.5;
  Tiles3dFaces flat;
  flat.Add({0, 2, 8}, 0);
  flat.Add({0, 8, 6}, 0);
  EXPECT_DOUBLE_EQ(Tiles3dDistance(mesh.vertices.positions, mesh.vertices, flat), 0.5);
}

std::vector<Eigen::Vector3d> TileZigzag(int count, uint64_t seed) {
  Random random(seed);
  std::vector<Eigen::Vector3d> chain;
  for (int i = 0; i < count; ++i) {
    const double z = (i / 50) % 2 == 0 ? 0 : 8;  // houses
    chain.push_back({0.15 * i, random.Uniform(-0.1, 0.1), z + random.Uniform(-0.1, 0.1)});
  }
  return chain;
}

TEST(SimplifyTiles3dChainTest, StaysWithinTheTolerance) {
  const std::vector<Eigen::Vector3d> chain = TileZigzag(2000, 1);
  for (const double tolerance_m : {0.05, 0.3, 3.0}) {
    const std::vector<size_t> kept = SimplifyTiles3dChain(chain, tolerance_m);
    EXPECT_EQ(kept.front(), 0u);
    EXPECT_EQ(kept.back(), chain.size() - 1);
    TilePlaceEdges edges;
    for (size_t k = 1; k < kept.size(); ++k) edges[{TilePlaceOf(chain[kept[k - 1]]), TilePlaceOf(chain[kept[k]])}] = 1;
    for (const Eigen::Vector3d& p : chain) EXPECT_LE(TileDistanceToEdges(TilePlaceOf(p), edges), tolerance_m);
  }
  EXPECT_LT(SimplifyTiles3dChain(chain, 0.3).size(), 400u);
}

TEST(SimplifyTiles3dChainTest, KeepsTheSameVerticesOfTheReversedChain) {
  std::vector<Eigen::Vector3d> chain = TileZigzag(2000, 2);
  std::vector<Eigen::Vector3d> loop(chain.begin(), chain.begin() + 200);
  for (int i = 0; i < 200; ++i) loop.push_back(chain[199 - i] + Eigen::Vector3d(0, 5, 0));
  loop.push_back(loop.front());
  for (std::vector<Eigen::Vector3d>* points : {&chain, &loop}) {
    const auto kept = [&] {
      std::set<TilePlace> places;
      for (const size_t i : SimplifyTiles3dChain(*points, 0.15)) places.insert(TilePlaceOf((*points)[i]));
      return places;
    };
    const std::set<TilePlace> forward = kept();
    std::reverse(points->begin(), points->end());
    EXPECT_EQ(kept(), forward);
    EXPECT_GT(forward.size(), 3u);
    EXPECT_LT(forward.size(), points->size() / 2);
  }
}

TEST(SimplifyTiles3dChainTest, ShrinksASmallLoopToAPoint) {
  EXPECT_EQ(SimplifyTiles3dChain({{0, 0, 0}, {0.1, 0, 0}, {0, 0.1, 0}, {0, 0, 0}}, 0.2), (std::vector<size_t>{0, 3}));
}

TEST(ThinTiles3dBorderTest, KeepsCornersWhereTilesMeetAndTheArea) {
  const Tiles3dMesh mesh = FlatTiles3d(20);
  const Tiles3dFaces alone = ThinTiles3dBorder(mesh.vertices, mesh.faces, {}, 0.1, 0.1);
  EXPECT_EQ(Tiles3dBorderEdges(alone, mesh.vertices.positions.size()).size(), 4u);
  EXPECT_DOUBLE_EQ(TileAreaOfLabel(mesh, alone, 0) + TileAreaOfLabel(mesh, alone, 1), 400);
  // Two more tiles below: they meet this one at (7, 0, 0).
  const Tiles3dFaces thinned = ThinTiles3dBorder(
      mesh.vertices, mesh.faces, {Tiles3dEdge{Eigen::Vector3d(7, 0, 0), Eigen::Vector3d(7, -1, 0)}}, 0.1, 0.1);
  const auto edges = Tiles3dBorderEdges(thinned, mesh.vertices.positions.size());
  EXPECT_EQ(edges.size(), 5u);
  EXPECT_TRUE(std::any_of(edges.begin(), edges.end(), [](const auto& edge) { return edge[0] == 7 || edge[1] == 7; }));
}

TEST(ThinTiles3dBorderTest, HasAToleranceOfItsOwnForRimsThatNoOtherTileHas) {
  Tiles3dMesh mesh = FlatTiles3d(20);
  Random random(6);
  for (Eigen::Vector3d& p : mesh.vertices.positions) p.z() = random.Uniform(-0.2, 0.2);
  std::vector<Tiles3dEdge> others;  // a tile along the side y = 0
  const std::vector<Eigen::Vector3d>& p = mesh.vertices.positions;
  for (int x = 0; x < 20; ++x) others.push_back({p[x + 1], p[x]});
  others.push_back({p[0], p[0] - Eigen::Vector3d::UnitX()});
  others.push_back({p[20] + Eigen::Vector3d::UnitX(), p[20]});
  const Tiles3dFaces thinned = ThinTiles3dBorder(mesh.vertices, mesh.faces, others, 0.01, 1);
  std::array<int, 2> sides = {0, 0};  // edges on y = 0, and others
  for (const auto& [a, b] : Tiles3dBorderEdges(thinned, p.size())) ++sides[p[a].y() == 0 && p[b].y() == 0 ? 0 : 1];
  EXPECT_GT(sides[0], 15);
  EXPECT_EQ(sides[1], 3);
}

TEST(Tiles3dPartTest, IsReadAsItWasWrittenAndRefusedIfItIsDamaged) {
  const TempFolder folder = *TempFolder::Create(testing::TempDir());
  const std::string path = folder.path() + "/part";
  Tiles3dPart part = {"start", FlatTiles3d(3), {Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(3, 3, 1)},
                      0.75,    {{1, 2, 3}},    0.5};
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
  EXPECT_EQ(read->samples, part.samples);
  EXPECT_EQ(read->samples_error_m, 0.5);
  EXPECT_EQ(read->box.max(), part.box.max());
  EXPECT_EQ(ReadTiles3dPart(path, "result")->mesh.faces.size(), 0u);
  part.mesh.faces.corners[0][0] = 16;
  ASSERT_TRUE(WriteTiles3dParts(path, {part}).ok());
  EXPECT_EQ(ReadTiles3dPart(path, "start").status().code(), absl::StatusCode::kDataLoss);
  part.mesh.faces.corners[0][0] = 0;
  part.mesh.vertices.normals.pop_back();
  ASSERT_TRUE(WriteTiles3dParts(path, {part}).ok());
  EXPECT_EQ(ReadTiles3dPart(path, "start").status().code(), absl::StatusCode::kDataLoss);
}

}  // namespace
}  // namespace tessera
