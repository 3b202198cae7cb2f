#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <random>
#include <set>

#include "common/exporting/obj/cut_by_rects.h"

namespace tessera {
namespace {

TileRects CutRects() {
  return TileRects::Of(std::vector<PlanRect>{{0, 0, 10, 10}, {10, 0, 20, 10}, {0, 10, 10, 20}, {10, 10, 20, 20}});
}

// A closed surface of about the size of CutRects(), whose vertices lie at random.
TriangleMesh RandomCutSphere(int rings, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> noise(-0.2, 0.2);
  const int sectors = 2 * rings;
  TriangleMesh mesh;
  const auto add = [&](double polar, double azimuth) {
    mesh.vertices.push_back({10.3 + 9 * std::sin(polar) * std::cos(azimuth) + noise(random),
                             9.7 + 9 * std::sin(polar) * std::sin(azimuth) + noise(random), 9 * std::cos(polar)});
  };
  add(0, 0);
  for (int i = 1; i < rings; ++i) {
    for (int j = 0; j < sectors; ++j) add(M_PI * i / rings, 2 * M_PI * j / sectors);
  }
  add(M_PI, 0);
  const auto at = [&](int i, int j) -> uint32_t {
    if (i == 0) return 0;
    if (i == rings) return static_cast<uint32_t>(mesh.vertices.size() - 1);
    return static_cast<uint32_t>(1 + (i - 1) * sectors + j % sectors);
  };
  for (int i = 0; i < rings; ++i) {
    for (int j = 0; j < sectors; ++j) {
      if (i > 0) mesh.faces.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
      if (i + 1 < rings) mesh.faces.push_back({at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)});
    }
  }
  return mesh;
}

using CutPosition = std::array<double, 3>;
CutPosition CutPositionOf(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

// The number of directed edges without an opposite one, by positions.
int64_t OpenCutEdges(std::span<const CutMesh> meshes) {
  std::map<std::pair<CutPosition, CutPosition>, int> edges;
  for (const CutMesh& mesh : meshes) {
    for (const Triangle& face : mesh.faces) {
      for (size_t k = 0; k < 3; ++k) {
        const CutPosition a = CutPositionOf(mesh.vertices[face[k]]),
                          b = CutPositionOf(mesh.vertices[face[(k + 1) % 3]]);
        ++edges[{a, b}];
        --edges[{b, a}];
      }
    }
  }
  return std::count_if(edges.begin(), edges.end(), [](const auto& edge) { return edge.second != 0; });
}

double CutAreaOf(const MeshSpans& mesh) {
  double area = 0;
  for (size_t f = 0; f < mesh.faces.size(); ++f) area += FaceArea(mesh, f);
  return area;
}
MeshSpans CutSpansOf(const CutMesh& mesh) { return {mesh.vertices, mesh.faces}; }

TEST(CutByRectsTest, NoFaceCrossesALineAndTheSurfaceStaysClosed) {
  const TileRects rects = CutRects();
  for (unsigned seed = 0; seed < 20; ++seed) {
    const TriangleMesh mesh = RandomCutSphere(12, seed);
    const CutMesh cut = CutByRects(mesh.vertices, mesh.faces, rects);
    EXPECT_EQ(OpenCutEdges({&cut, 1}), 0);
    EXPECT_NEAR(CutAreaOf(CutSpansOf(cut)), CutAreaOf(mesh), 1e-9 * CutAreaOf(mesh));
    EXPECT_GT(cut.faces.size(), mesh.faces.size());
    EXPECT_TRUE(std::is_sorted(cut.source_faces.begin(), cut.source_faces.end()));
    for (size_t v = 0; v < cut.vertices.size(); ++v) {
      const Eigen::Vector3d& p = cut.vertices[v];
      if (v < mesh.vertices.size()) {
        EXPECT_EQ(p, mesh.vertices[v]);
      } else {
        EXPECT_TRUE(p.x() == 10 || p.y() == 10) << p.transpose();
      }
    }
    for (size_t f = 0; f < cut.faces.size(); ++f) {
      EXPECT_GT(FaceArea(CutSpansOf(cut), f), 0);
      for (const uint32_t v : cut.faces[f]) {
        const Eigen::Vector3d& p = cut.vertices[v];
        EXPECT_TRUE(cut.tiles[f] % 2 == 0 ? p.x() <= 10 : p.x() >= 10) << p.transpose();
        EXPECT_TRUE(cut.tiles[f] / 2 == 0 ? p.y() <= 10 : p.y() >= 10) << p.transpose();
      }
      const Eigen::Vector3d normal = FaceNormal(mesh, cut.source_faces[f]);
      EXPECT_GT(normal.dot(FaceCross(CutSpansOf(cut), f)), 0);
    }
  }
}

TEST(CutByRectsTest, PartsThatAreCutApartFitTogetherBitForBit) {
  const TileRects rects = CutRects();
  const TriangleMesh mesh = RandomCutSphere(14, 3);
  std::vector<CutMesh> parts;
  for (size_t first = 0; first < 4; ++first) {  // every fourth face, in another order and from another corner
    std::vector<Triangle> faces;
    for (size_t f = first; f < mesh.faces.size(); f += 4) {
      Triangle face = mesh.faces[f];
      std::rotate(face.begin(), face.begin() + static_cast<std::ptrdiff_t>(first % 3), face.end());
      faces.insert(faces.begin(), face);
    }
    parts.push_back(CutByRects(mesh.vertices, faces, rects));
  }
  EXPECT_EQ(OpenCutEdges(parts), 0);
}

TEST(CutByRectsTest, ALongFaceIsCutAtManyLines) {
  std::vector<PlanRect> columns;
  for (int k = 0; k < 50; ++k) columns.push_back({1.0 * k, 0, k + 1.0, 1});
  const TileRects rects = TileRects::Of(columns);
  const std::vector<Eigen::Vector3d> vertices = {{0.5, 0.1, 0}, {49.5, 0.4, 7}, {20.25, 0.9, 3}};
  const std::vector<Triangle> faces = {{0, 1, 2}};
  const CutMesh cut = CutByRects(vertices, faces, rects);
  EXPECT_EQ(cut.vertices.size(), 3u + 2 * 49);
  EXPECT_EQ(std::set<int32_t>(cut.tiles.begin(), cut.tiles.end()).size(), 50u);
  EXPECT_NEAR(CutAreaOf(CutSpansOf(cut)), CutAreaOf({vertices, faces}), 1e-12);
}

TEST(CutByRectsTest, VerticesOnLinesGiveNoPartsWithoutArea) {
  const TileRects rects = CutRects();
  const std::vector<Eigen::Vector3d> vertices = {{10, 2, 0},        {10, 8, 0}, {10, 5, 4}, {4, 5, 0},
                                                 {10 + 1e-9, 4, 0}, {16, 5, 0}, {10, 10, 0}};
  // On a line, at its sides, with a vertex nearly on it, and through the corner of four tiles.
  const std::vector<Triangle> faces = {{0, 1, 2}, {3, 0, 1}, {4, 5, 3}, {3, 5, 6}};
  const CutMesh cut = CutByRects(vertices, faces, rects);
  EXPECT_EQ(cut.vertices[4].x(), 10);
  std::vector<int> parts(4);
  for (size_t f = 0; f < cut.faces.size(); ++f) {
    ++parts[cut.source_faces[f]];
    EXPECT_GT(FaceArea(CutSpansOf(cut), f), 1e-6);
  }
  EXPECT_THAT(parts, testing::ElementsAre(1, 1, 2, 2));
  EXPECT_EQ(cut.tiles[0], 1);  // on a line: the tile above it
  EXPECT_EQ(cut.tiles[1], 0);
}

}  // namespace
}  // namespace tessera
