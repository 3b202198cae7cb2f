// Meshes that are no surfaces: every face on its own, fans around edges, specks in the air.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>
#include <vector>

#include "common/base/random.h"
#include "common/exporting/tiles3d/tiles3d_pieces.h"
#include "common/exporting/tiles3d/tiles3d_simplify.h"
#include "common/exporting/tiles3d/tiles3d_upper.h"
#include "common/geometry/nearest_surface.h"

namespace tessera {
namespace {

// A square of ground with bad meshes above it, up to 20 m high.
class SoupMaker {
 public:
  SoupMaker(double side_m, uint64_t seed) : side_m_(side_m), random_(seed) {}

  Tiles3dMesh Make(int ground, int triangles, int fans, int specks) {
    for (int y = 0; y < ground; ++y) {
      for (int x = 0; x < ground; ++x) {
        const double step_m = side_m_ / ground;
        const Eigen::Vector3d p(x * step_m, y * step_m, 0), u(step_m, 0, 0), v(0, step_m, 0);
        Add(p, p + u, p + u + v);  // each with vertices of its own
        Add(p, p + u + v, p + v);
      }
    }
    for (int i = 0; i < triangles; ++i) {
      const Eigen::Vector3d p = Place();
      Add(p, p + Offset(), p + Offset());
    }
    for (int i = 0; i < fans; ++i) {
      const auto first = static_cast<uint32_t>(mesh_.vertices.positions.size());
      const Eigen::Vector3d p = Place();
      for (int k = 0; k < 7; ++k) AddVertex(k == 0 ? p : p + Offset());
      for (uint32_t k = 2; k < 7; ++k) mesh_.faces.Add({first, first + 1, first + k}, 1);
    }
    for (int i = 0; i < specks; ++i) {
      const auto first = static_cast<uint32_t>(mesh_.vertices.positions.size());
      const Eigen::Vector3d p = Place();
      for (int k = 0; k < 4; ++k) AddVertex(p + 0.1 * Offset());
      for (const Triangle& face : {Triangle{0, 1, 2}, Triangle{0, 3, 1}, Triangle{1, 3, 2}, Triangle{2, 3, 0}}) {
        mesh_.faces.Add({first + face[0], first + face[1], first + face[2]}, 2);
      }
    }
    mesh_.vertices.shared.assign(mesh_.vertices.positions.size(), 0);
    return mesh_;
  }

 private:
  Eigen::Vector3d Place() { return {random_.Uniform(0, side_m_), random_.Uniform(0, side_m_), random_.Uniform(0, 20)}; }
  Eigen::Vector3d Offset() { return {random_.Uniform(-1, 1), random_.Uniform(-1, 1), random_.Uniform(-1, 1)}; }
  void AddVertex(const Eigen::Vector3d& p) {
    mesh_.vertices.positions.push_back((p / kTiles3dGrid_m).array().round() * kTiles3dGrid_m);
    mesh_.vertices.normals.push_back(Eigen::Vector3f::UnitZ());
  }
  void Add(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
    const auto first = static_cast<uint32_t>(mesh_.vertices.positions.size());
    for (const Eigen::Vector3d& p : {a, b, c}) AddVertex(p);
    mesh_.faces.Add({first, first + 1, first + 2}, 0);
  }

  const double side_m_;
  Random random_;
  Tiles3dMesh mesh_;
};

double SoupDistance(const std::vector<Tiles3dPoint>& points, const Tiles3dVertices& vertices,
                    const Tiles3dFaces& faces) {
  const TriangleMesh mesh = {vertices.positions, faces.corners, {}};
  const NearestSurface surface(mesh);
  double distance_m = 0;
  for (const Tiles3dPoint& p : points) distance_m = std::max(distance_m, surface.Find(p.position).distance_m);
  return distance_m;
}

// A city of equal soup: each level has four tiles of the level below.
TEST(Tiles3dSoupTest, HasFewTrianglesAtEveryLevelAndTheErrorOfItsSide) {
  for (const auto& [triangles, fans, specks] :
       {std::array{20000, 0, 0}, std::array{0, 4000, 0}, std::array{0, 0, 6000}, std::array{6000, 1200, 2000}}) {
    Tiles3dSizes sizes;
    sizes.node_faces = 1600;  // a tenth: so are the meshes
    double side_m = 60, error_m = 0;
    Tiles3dPart part;
    part.mesh = SoupMaker(side_m, 3).Make(20, triangles, fans, specks);
    for (const Eigen::Vector3d& p : part.mesh.vertices.positions) part.box.extend(p);
    for (; side_m < 4000; side_m *= 2) {
      std::vector<Tiles3dPart> children;
      for (int i = 0; i < 4; ++i) {
        Tiles3dPart child = part;
        const Eigen::Vector3d shift = side_m * Eigen::Vector3d(i % 2, i / 2, 0);
        for (Eigen::Vector3d& p : child.mesh.vertices.positions) p += shift;
        for (Tiles3dPoint& p : child.samples) p.position += shift;
        children.push_back(std::move(child));
      }
      part = MergeTiles3dParts(std::move(children));
      error_m = SimplifyTiles3dPart({}, 2 * side_m, error_m, false, sizes, &part);
      std::printf("%5.0f m: %zu triangles, %.2f m\n", 2 * side_m, part.mesh.faces.size(), error_m);
      EXPECT_LE(part.mesh.faces.size(), 2 * sizes.node_faces);
      EXPECT_LE(SoupDistance(part.samples, part.mesh.vertices, part.mesh.faces), part.error_m + 1e-9);
      if (side_m < 1000) continue;  // the soup is about as high as the error
      EXPECT_LE(part.mesh.faces.size(), 1.25 * static_cast<double>(sizes.node_faces));
      EXPECT_LE(error_m, 1.01 * sizes.error * 2 * side_m);
    }
  }
}

TEST(WithoutSmallTiles3dPiecesTest, LeavesOutTheSmallestUntilEnoughAreLeft) {
  const Tiles3dMesh mesh = SoupMaker(60, 5).Make(20, 0, 0, 1000);
  std::vector<Tiles3dPoint> points = {{mesh.vertices.positions[0], 0}, {mesh.vertices.positions.back(), 4799}};
  const std::vector<uint8_t> none(mesh.vertices.positions.size(), 0);
  // All specks are below the size.
  const Tiles3dFaces kept = WithoutSmallTiles3dPieces(mesh.vertices, mesh.faces, none, {0, 1, 0}, &points);
  EXPECT_EQ(kept.size(), 800u);
  EXPECT_EQ(points.size(), 1u);
  std::vector<Tiles3dPoint> no_points;
  const size_t some = WithoutSmallTiles3dPieces(mesh.vertices, mesh.faces, none, {0, 1, 2000}, &no_points).size();
  EXPECT_LE(some, 2000u);
  EXPECT_GT(some, 1990u);
  // A fixed vertex keeps its piece.
  std::vector<uint8_t> fixed = none;
  fixed.back() = 1;
  EXPECT_EQ(WithoutSmallTiles3dPieces(mesh.vertices, mesh.faces, fixed, {0, 1, 0}, &no_points).size(), 804u);
}

}  // namespace
}  // namespace tessera
