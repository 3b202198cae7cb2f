#include "common/geometry/ray_caster.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "common/base/parallel.h"
#include "common/base/random.h"

namespace tessera {
namespace {

// Random small triangles around `centre`.
TriangleMesh Soup(int faces, const Eigen::Vector3d& centre, uint64_t seed) {
  Random random(seed);
  TriangleMesh mesh;
  const auto offset = [&](double size) {
    return Eigen::Vector3d(random.Uniform(-size, size), random.Uniform(-size, size), random.Uniform(-size, size));
  };
  for (int f = 0; f < faces; ++f) {
    const Eigen::Vector3d middle = centre + offset(50);
    const uint32_t first = static_cast<uint32_t>(mesh.vertices.size());
    for (int k = 0; k < 3; ++k) mesh.vertices.push_back(middle + offset(5));
    mesh.faces.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

// Reference: tests every face in double precision.
RayHit BruteForce(const TriangleMesh& mesh, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) {
  RayHit best;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const Eigen::Vector3d e1 = mesh.Corner(f, 1) - mesh.Corner(f, 0), e2 = mesh.Corner(f, 2) - mesh.Corner(f, 0);
    const Eigen::Vector3d p = direction.cross(e2);
    const double det = e1.dot(p);
    const Eigen::Vector3d s = origin - mesh.Corner(f, 0);
    const double u = s.dot(p) / det;
    const Eigen::Vector3d q = s.cross(e1);
    const double v = direction.dot(q) / det;
    const double t = e2.dot(q) / det;
    if (u < 0 || v < 0 || u + v > 1 || t <= 0) continue;
    if (!best.hit() || t < best.distance) best = {static_cast<int64_t>(f), t, u, v};
  }
  return best;
}

class RayTreeTest : public testing::TestWithParam<RayTree> {};

INSTANTIATE_TEST_SUITE_P(All, RayTreeTest, testing::Values(RayTree::kThorough, RayTree::kQuick));

// 5,000 km from the origin, cameras a kilometre away.
TEST_P(RayTreeTest, MatchesBruteForceFarFromTheOrigin) {
  const Eigen::Vector3d centre(3.9e6, 3.1e5, 5.0e6);
  const TriangleMesh mesh = Soup(300, centre, 7);
  const RayCaster caster(mesh, GetParam());
  Random random(3);
  int hits = 0;
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3d origin =
        centre + 1000 * Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal()).normalized();
    const Eigen::Vector3d target =
        centre + Eigen::Vector3d(random.Uniform(-50, 50), random.Uniform(-50, 50), random.Uniform(-50, 50));
    const Eigen::Vector3d direction = 0.01 * (target - origin);
    const RayHit expected = BruteForce(mesh, origin, direction);
    const RayHit found = caster.Cast(origin, direction);
    // Rays within float rounding of an edge may go either way.
    if (expected.hit() && std::min({expected.u, expected.v, 1 - expected.u - expected.v}) < 1e-4) continue;
    ASSERT_EQ(found.face, expected.face) << i;
    if (!expected.hit()) continue;
    ++hits;
    EXPECT_NEAR(found.distance * direction.norm(), expected.distance * direction.norm(), 1e-3);
    EXPECT_NEAR(found.u, expected.u, 1e-3);
    EXPECT_NEAR(found.v, expected.v, 1e-3);
    const Eigen::Vector3d point = origin + found.distance * direction;
    EXPECT_FALSE(caster.Occluded(origin, point, 0.01));
    EXPECT_TRUE(caster.Occluded(origin, point + direction.normalized(), 0.01));
  }
  EXPECT_GT(hits, 300);
}

TEST(RayCaster, RespectsNearAndFarAndHitsBothSides) {
  TriangleMesh mesh;
  for (double z : {0.0, 10.0}) {
    const uint32_t first = static_cast<uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), {{-1, -1, z}, {4, -1, z}, {-1, 4, z}});
    mesh.faces.push_back({first, first + 1, first + 2});
  }
  const RayCaster caster(mesh);
  const Eigen::Vector3d up(0, 0, 2);
  const RayHit first = caster.Cast({0, 0, -4}, up);
  EXPECT_EQ(first.face, 0);
  EXPECT_DOUBLE_EQ(first.distance, 2);
  EXPECT_NEAR(first.u, 0.2, 1e-6);
  EXPECT_NEAR(first.v, 0.2, 1e-6);
  EXPECT_EQ(caster.Cast({0, 0, -4}, up, 2.1).face, 1);
  EXPECT_FALSE(caster.Cast({0, 0, -4}, up, 0, 1.9).hit());
  EXPECT_FALSE(caster.Cast({0, 0, -4}, up, 2.1, 6.9).hit());
  EXPECT_EQ(caster.Cast({0, 0, 20}, -up).face, 1);
  EXPECT_FALSE(caster.Cast({9, 9, -4}, up).hit());
  EXPECT_TRUE(caster.Occluded({0, 0, -1}, {0, 0, 1}, 0.1));
  EXPECT_FALSE(caster.Occluded({0, 0, 0}, {0, 0, 10}, 0.1));
  EXPECT_FALSE(caster.Occluded({0, 0, -1}, {0, 0, 1}, 1.5));
}

TEST(RayCaster, EmptyMeshIsNeverHit) {
  const RayCaster caster(TriangleMesh{});
  EXPECT_FALSE(caster.Cast({0, 0, 0}, {0, 0, 1}).hit());
  EXPECT_FALSE(caster.Occluded({0, 0, 0}, {0, 0, 1}, 0));
  const RayCaster soup(Soup(10, {0, 0, 0}, 1));
  EXPECT_FALSE(soup.Cast({0, 0, 0}, {0, 0, 0}).hit());
  EXPECT_FALSE(soup.Cast({0, 0, NAN}, {0, 0, 1}).hit());
}

// Rays through the vertices of a grid, where several faces tie.
TEST_P(RayTreeTest, TiesDoNotDependOnThreads) {
  TriangleMesh mesh;
  const int n = 100;
  for (int y = 0; y <= n; ++y)
    for (int x = 0; x <= n; ++x) mesh.vertices.push_back({double(x), double(y), 0});
  for (uint32_t y = 0; y < n; ++y)
    for (uint32_t x = 0; x < n; ++x) {
      const uint32_t a = y * (n + 1) + x, b = a + 1, c = a + n + 1, d = c + 1;
      mesh.faces.push_back({a, b, d});
      mesh.faces.push_back({a, d, c});
    }
  const auto faces = [&](int threads) {
    const ThreadLimit limit(threads);
    const RayCaster caster(mesh, GetParam());
    std::vector<int64_t> found(mesh.vertices.size());
    ParallelFor(static_cast<int64_t>(found.size()), 64, [&](int64_t begin, int64_t end) {
      for (int64_t v = begin; v < end; ++v)
        found[v] = caster.Cast(mesh.vertices[v] + Eigen::Vector3d(0, 0, 5), {0, 0, -1}).face;
    });
    return found;
  };
  const std::vector<int64_t> one = faces(1);
  // No ray passes between faces; at the boundary, rounding may decide either way.
  for (int y = 1; y < n; ++y)
    for (int x = 1; x < n; ++x) ASSERT_GE(one[y * (n + 1) + x], 0) << x << " " << y;
  EXPECT_EQ(one, faces(2));
}

}  // namespace
}  // namespace tessera
