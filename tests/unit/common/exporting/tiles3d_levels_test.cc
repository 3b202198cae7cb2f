#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "common/exporting/export_map.h"
#include "common/exporting/tiles3d/tiles3d_border.h"
#include "common/exporting/tiles3d/tiles3d_mesh.h"
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

// Undirected edges with the number of their faces.
TilePlaceEdges TileEdgesOf(const std::vector<TriangleMesh>& meshes) {
  TilePlaceEdges edges;
  for (const TriangleMesh& mesh : meshes) {
    for (const TilePlaceFace& face : TileFacesOf(mesh)) {
      for (int k = 0; k < 3; ++k) ++edges[{std::min(face[k], face[(k + 1) % 3]), std::max(face[k], face[(k + 1) % 3])}];
    }
  }
  return edges;
}

TEST(Tiles3dLevelsTest, HaveNoCracksBetweenTilesOfOneLevelNorInSheets) {
  for (const uint64_t seed : {1, 2, 3}) {
    ExportedTerrain terrain(90, seed);
    terrain.sizes.border_tolerance = 0.005;
    terrain.Write();
    int inner = 0;
    std::map<int, TilePlaceEdges> sums;  // of the border edges of all tiles of a level above the sheets
    TilePlaceEdges outer;
    const ReadTile root = ReadTiles3d(terrain.path("result"));
    const TilePlaceEdges all = TileEdgesOf(VisitTiles(root, [](const auto&, const auto&, const auto&) {}));
    VisitTiles(root, [&](const ReadTile& tile, const TriangleMesh& mesh, const std::vector<TriangleMesh>& leaves) {
      std::vector<TilePlaceFace> finest;
      for (const TriangleMesh& leaf : leaves) {
        const std::vector<TilePlaceFace> faces = TileFacesOf(leaf);
        finest.insert(finest.end(), faces.begin(), faces.end());
      }
      outer = TileBorderEdges(finest);
      const TilePlaceEdges edges = TileBorderEdges(TileFacesOf(mesh));
      if (!tile.is_leaf) ++inner;
      const int level = TileLevelOf(tile);
      // Every tile of a sheet has the edges that the finest tiles below it have in common with others, so
      // any two fit together.
      if (level == 0) {
        const TilePlaceEdges own = TileEdgesOf({mesh});
        int common = 0;
        for (const auto& [edge, count] : TileEdgesOf(leaves)) {
          if (all.at(edge) == count) continue;
          ++common;
          EXPECT_TRUE(own.contains(edge)) << tile.path;
        }
        EXPECT_GT(common, 10);
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

}  // namespace
}  // namespace tessera
