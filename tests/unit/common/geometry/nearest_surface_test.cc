#include "common/geometry/nearest_surface.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "common/base/random.h"

namespace tessera {
namespace {

TriangleMesh RandomTriangles(int count, const Eigen::Vector3d& origin, uint64_t seed) {
  Random random(seed);
  TriangleMesh mesh;
  for (int f = 0; f < count; ++f) {
    const Eigen::Vector3d centre(random.Uniform(-50, 50), random.Uniform(-50, 50), random.Uniform(0, 20));
    for (int k = 0; k < 3; ++k) {
      mesh.vertices.push_back(origin + centre +
                              Eigen::Vector3d(random.Uniform(-2, 2), random.Uniform(-2, 2), random.Uniform(-2, 2)));
    }
    const uint32_t first = static_cast<uint32_t>(3 * f);
    mesh.faces.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

// Reference: the nearest point by a fine search over the triangle.
double DistanceBySampling(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                          const Eigen::Vector3d& c) {
  double best = 1e300;
  constexpr int kSteps = 400;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; i + j <= kSteps; ++j) {
      const double u = static_cast<double>(i) / kSteps, v = static_cast<double>(j) / kSteps;
      best = std::min(best, (p - (a + u * (b - a) + v * (c - a))).norm());
    }
  }
  return best;
}

TEST(NearestPointOfTriangle, MatchesBruteForce) {
  Random random(3);
  const auto point = [&] {
    return Eigen::Vector3d(random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(-1, 1));
  };
  for (int i = 0; i < 30; ++i) {
    const Eigen::Vector3d a = point(), b = point(), c = point(), p = 2 * point();
    const double found = (NearestPointOfTriangle(p, a, b, c) - p).norm();
    const double searched = DistanceBySampling(p, a, b, c);
    EXPECT_LE(found, searched + 1e-12);
    EXPECT_NEAR(found, searched, 5e-3);
  }
}

TEST(NearestPointOfTriangle, HandlesDegenerateTriangles) {
  const Eigen::Vector3d a(0, 0, 0), b(2, 0, 0), p(1, 3, 0);
  EXPECT_NEAR((NearestPointOfTriangle(p, a, b, a) - p).norm(), 3, 1e-12);
  EXPECT_NEAR((NearestPointOfTriangle(p, a, a, a) - p).norm(), std::sqrt(10), 1e-12);
}

// Also thousands of kilometres from the origin, where the spacing of floats is half a metre.
TEST(NearestSurface, MatchesBruteForce) {
  for (const Eigen::Vector3d& origin : {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(5e6, -3e6, 400)}) {
    const TriangleMesh mesh = RandomTriangles(500, origin, 7);
    const NearestSurface surface(mesh);
    Random random(8);
    for (int i = 0; i < 500; ++i) {
      const Eigen::Vector3d p =
          origin + Eigen::Vector3d(random.Uniform(-80, 80), random.Uniform(-80, 80), random.Uniform(-30, 60));
      double best = 1e300;
      int64_t best_face = -1;
      for (size_t f = 0; f < mesh.faces.size(); ++f) {
        const double d =
            (NearestPointOfTriangle(p, mesh.Corner(f, 0), mesh.Corner(f, 1), mesh.Corner(f, 2)) - p).norm();
        if (d < best) best = d, best_face = static_cast<int64_t>(f);
      }
      const NearestPoint found = surface.Find(p);
      EXPECT_DOUBLE_EQ(found.distance_m, best);
      EXPECT_EQ(found.face, best_face);
      EXPECT_NEAR((found.point - p).norm(), best, 1e-9);
    }
  }
}

TEST(NearestSurface, TiesReturnTheLowestFace) {
  TriangleMesh mesh = RandomTriangles(1, {0, 0, 0}, 1);
  mesh.faces.push_back(mesh.faces[0]);
  mesh.faces.push_back(mesh.faces[0]);
  EXPECT_EQ(NearestSurface(mesh).Find({1, 2, 3}).face, 0);
}

TEST(NearestSurface, EmptyMeshHasNoNearestFace) { EXPECT_EQ(NearestSurface(TriangleMesh()).Find({0, 0, 0}).face, -1); }

}  // namespace
}  // namespace tessera
