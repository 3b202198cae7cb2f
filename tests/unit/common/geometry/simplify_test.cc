#include "common/geometry/simplify.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

#include "common/base/random.h"
#include "common/geometry/nearest_surface.h"

namespace tessera {
namespace {

// Hills, a terrace with a step, and thorns here and there: what means over areas overlook.
TriangleMesh Terrain(int side, uint64_t seed, const Eigen::Vector3d& offset = Eigen::Vector3d::Zero()) {
  Random random(seed);
  TriangleMesh mesh;
  for (int y = 0; y <= side; ++y) {
    for (int x = 0; x <= side; ++x) {
      double z = 0.3 * std::sin(0.2 * x) * std::cos(0.13 * y) + (x > side / 2 ? 4 : 0) + 0.02 * random.Normal();
      if (random.Uniform() < 0.01) z += 0.4;
      mesh.vertices.push_back(offset + Eigen::Vector3d(x, y, z));
    }
  }
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const uint32_t a = static_cast<uint32_t>(y * (side + 1) + x), b = a + 1, c = b + side, d = c + 1;
      mesh.faces.push_back({a, b, d});
      mesh.faces.push_back({a, d, c});
    }
  }
  return mesh;
}

double FarthestSample(const TriangleMesh& from, const TriangleMesh& to, int steps) {
  const NearestSurface surface(to);
  double farthest = 0;
  for (size_t f = 0; f < from.faces.size(); ++f) {
    for (int i = 0; i <= steps; ++i) {
      for (int j = 0; i + j <= steps; ++j) {
        const Eigen::Vector3d p =
            from.Corner(f, 0) +
            (i * (from.Corner(f, 1) - from.Corner(f, 0)) + j * (from.Corner(f, 2) - from.Corner(f, 0))) / steps;
        farthest = std::max(farthest, surface.Find(p).distance_m);
      }
    }
  }
  return farthest;
}

using Point = std::array<double, 3>;
std::map<std::pair<Point, Point>, int> RimEdges(const TriangleMesh& mesh) {
  std::map<std::pair<Point, Point>, int> edges;
  const auto point = [&](uint32_t v) {
    return Point{mesh.vertices[v].x(), mesh.vertices[v].y(), mesh.vertices[v].z()};
  };
  for (const Triangle& face : mesh.faces) {
    for (int k = 0; k < 3; ++k) {
      const Point a = point(face[k]), b = point(face[(k + 1) % 3]);
      const auto opposite = edges.find({b, a});
      if (opposite == edges.end()) {
        ++edges[{a, b}];
      } else if (--opposite->second == 0) {
        edges.erase(opposite);
      }
    }
  }
  return edges;
}

TriangleMesh Half(const TriangleMesh& mesh, double x_low, double x_high) {
  TriangleMesh half = mesh;
  half.faces.clear();
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const double x = (mesh.Corner(f, 0) + mesh.Corner(f, 1) + mesh.Corner(f, 2)).x() / 3;
    if (x >= x_low && x < x_high) half.faces.push_back(mesh.faces[f]);
  }
  return half;
}

// At samples denser than those that SimplifyMesh looks at.
TEST(SimplifyMesh, NeitherSurfaceIsFartherFromTheOtherThanTolerated) {
  for (const double tolerance_m : {0.05, 0.1, 0.3}) {
    for (uint64_t seed = 0; seed < 3; ++seed) {
      const TriangleMesh mesh = Terrain(40, seed), simple = SimplifyMesh(mesh, tolerance_m);
      EXPECT_LT(simple.faces.size(), mesh.faces.size());
      EXPECT_LE(FarthestSample(mesh, simple, 4), tolerance_m) << tolerance_m << " seed " << seed;
      EXPECT_LE(FarthestSample(simple, mesh, 16), tolerance_m) << tolerance_m << " seed " << seed;
    }
  }
  EXPECT_LT(SimplifyMesh(Terrain(40, 1), 0.2).faces.size(), Terrain(40, 1).faces.size() / 3);
}

TEST(SimplifyMesh, RimsStaySoThatPartsFitAndNoHoleOpens) {
  const TriangleMesh mesh = Terrain(40, 3);
  const TriangleMesh left = Half(mesh, -1, 17), right = Half(mesh, 17, 100);
  const TriangleMesh simple_left = SimplifyMesh(left, 0.15), simple_right = SimplifyMesh(right, 0.15);
  ASSERT_LT(simple_left.faces.size() + simple_right.faces.size(), mesh.faces.size() / 2);
  EXPECT_EQ(RimEdges(simple_left), RimEdges(left));
  EXPECT_EQ(RimEdges(simple_right), RimEdges(right));
}

TEST(SimplifyMesh, VerticesAreTheInputsInItsOrder) {
  const TriangleMesh mesh = Terrain(30, 5), simple = SimplifyMesh(mesh, 0.1);
  size_t next = 0;
  for (const Eigen::Vector3d& p : simple.vertices) {
    while (next < mesh.vertices.size() && mesh.vertices[next] != p) ++next;
    ASSERT_LT(next, mesh.vertices.size());
  }
  EXPECT_EQ(SimplifyMesh(mesh, 0.1).faces, simple.faces);
}

// By multiples of what doubles hold exactly there.
TEST(SimplifyMesh, TheSameFarFromTheOrigin) {
  const Eigen::Vector3d offset(500000, 5000000, 0);
  TriangleMesh mesh = Terrain(30, 5);
  for (Eigen::Vector3d& p : mesh.vertices) p = (p.array() * 1024).round() / 1024;
  TriangleMesh far = mesh;
  for (Eigen::Vector3d& p : far.vertices) p += offset;
  EXPECT_EQ(SimplifyMesh(far, 0.1).faces, SimplifyMesh(mesh, 0.1).faces);
}

TEST(SimplifyMesh, WithoutToleranceAllFacesStayAndUnusedVerticesGo) {
  TriangleMesh mesh = Terrain(4, 1);
  const size_t vertices = mesh.vertices.size();
  mesh.vertices.push_back({1, 2, 3});
  const TriangleMesh same = SimplifyMesh(mesh, 0);
  EXPECT_EQ(same.faces, mesh.faces);
  EXPECT_EQ(same.vertices.size(), vertices);
  EXPECT_TRUE(SimplifyMesh(TriangleMesh(), 1).faces.empty());
}

// What is smaller than the tolerance would vanish as a whole: then it stays, for nothing is there instead.
TEST(SimplifyMesh, SmallPartsDoNotVanish) {
  TriangleMesh mesh;
  for (int i = 0; i < 3; ++i) {
    const uint32_t base = static_cast<uint32_t>(mesh.vertices.size());
    const Eigen::Vector3d at(10.0 * i, 0, 0);
    for (const Eigen::Vector3d& p : {Eigen::Vector3d(0, 0, 0), {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}) {
      mesh.vertices.push_back(at + 0.1 * p);
    }
    for (const Triangle& face : {Triangle{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}}) {
      mesh.faces.push_back({base + face[0], base + face[1], base + face[2]});
    }
  }
  EXPECT_LE(FarthestSample(mesh, SimplifyMesh(mesh, 0.5), 4), 0.5);
}

}  // namespace
}  // namespace tessera
