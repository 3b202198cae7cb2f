#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "common/evaluate/surface_samples.h"
#include "common/evaluate/surface_scores.h"
#include "tests/unit/common/evaluate/flat_world.h"

namespace tessera {
namespace {

TEST(SampleByArea, IsUniformByAreaAndOnTheFaces) {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {3, 0, 0}, {0, 3, 0}, {10, 0, 5}, {11, 0, 5}, {10, 1, 5}};
  mesh.faces = {{0, 1, 2}, {0, 0, 1}, {3, 4, 5}};  // nine to one, and a face without area
  const auto samples = SampleByArea(mesh, 10000, 1);
  ASSERT_EQ(samples.size(), 10000u);
  int64_t large = 0;
  Eigen::Vector3d mean(0, 0, 0);
  for (const SurfaceSample& s : samples) {
    ASSERT_NE(s.face, 1u);
    if (s.face != 0) {
      EXPECT_DOUBLE_EQ(s.point.z(), 5);
      continue;
    }
    ++large;
    mean += s.point;
    EXPECT_GE(s.point.minCoeff(), 0);
    EXPECT_LE(s.point.x() + s.point.y(), 3 + 1e-12);
  }
  EXPECT_NEAR(static_cast<double>(large), 9000, 2);
  mean /= static_cast<double>(large);
  EXPECT_NEAR(mean.x(), 1, 0.05);  // the triangle's centroid
  EXPECT_NEAR(mean.y(), 1, 0.05);
}

TEST(SampleByArea, IsDeterministicPerSeed) {
  const TriangleMesh mesh = FlatSquare(10, 4, 0);
  const auto a = SampleByArea(mesh, 100, 1), b = SampleByArea(mesh, 100, 1), c = SampleByArea(mesh, 100, 2);
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(a[i].point, b[i].point);
    EXPECT_NE(a[i].point, c[i].point);
  }
}

TEST(SampleByArea, IsEmptyWithoutArea) {
  TriangleMesh mesh;
  EXPECT_TRUE(SampleByArea(mesh, 10, 1).empty());
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  mesh.faces = {{0, 1, 2}};
  EXPECT_TRUE(SampleByArea(mesh, 10, 1).empty());
}

TEST(SeenSamples, TestsImageBoundsAndOcclusion) {
  // A square of 10 m with a smaller one 2 m above its middle.
  TriangleMesh mesh = FlatSquare(10, 1, 0);
  const TriangleMesh roof = FlatSquare(2, 1, 2, {4, 4, 0});
  for (const Triangle& face : roof.faces) mesh.faces.push_back({face[0] + 4, face[1] + 4, face[2] + 4});
  mesh.vertices.insert(mesh.vertices.end(), roof.vertices.begin(), roof.vertices.end());
  const RayCaster caster(mesh);
  // One camera sees the whole square, one only a corner of 2 m; the smaller square occludes the middle for both.
  const std::vector<SceneView> views = {ViewFromAbove({5, 5, 1000}, 12, 100), ViewFromAbove({1, 1, 1000}, 2, 100)};
  const std::vector<SurfaceSample> samples = {
      {{1, 1, 0}, 0}, {{8, 3, 0}, 0}, {{5, 5, 0}, 0}, {{5, 5, 2}, 2}, {{20, 5, 0}, 0}};
  const auto points = [&](int min_views) {
    std::vector<double> x_plus_z;
    for (const SurfaceSample& s : SeenSamples(samples, caster, views, min_views)) {
      x_plus_z.push_back(s.point.x() + s.point.z());
    }
    return x_plus_z;
  };
  EXPECT_THAT(points(1), testing::ElementsAre(1, 8, 7));
  EXPECT_THAT(points(2), testing::ElementsAre(1));
  EXPECT_THAT(points(3), testing::IsEmpty());
}

MeasuredPoint At(double distance_m, int truth_class = 0, double agreement = 1) {
  return {distance_m, agreement, truth_class};
}

TEST(ComputeStatistics, MatchesKnownDistances) {
  const DistanceStatistics s = ComputeStatistics({At(0.1, 0, 0.5), At(0.4), At(0.2), At(0.3), At(2.0)}, 0.5);
  EXPECT_EQ(s.points, 5);
  EXPECT_NEAR(s.mean_m, 0.6, 1e-12);
  EXPECT_NEAR(s.capped_mean_m, 0.3, 1e-12);
  EXPECT_NEAR(s.median_m, 0.3, 1e-12);
  EXPECT_NEAR(s.percentile90_m, 0.4 + 0.6 * 1.6, 1e-12);
  EXPECT_NEAR(s.normal_consistency, 0.9, 1e-12);
  EXPECT_TRUE(std::isnan(ComputeStatistics({}, 0.5).mean_m));
}

TEST(ScoreSurface, FScoreIsTheHarmonicMean) {
  const std::vector<MeasuredPoint> on_result = {At(0.01), At(0.3)};                     // precision 1/2
  const std::vector<MeasuredPoint> on_truth = {At(0.01), At(0.02), At(0.04), At(0.3)};  // recall 3/4
  const SurfaceScores s = ScoreSurface(on_result, on_truth, 0.5, {0.05, 1.0, 0.001});
  ASSERT_EQ(s.f_scores.size(), 3u);
  EXPECT_NEAR(s.f_scores[0].precision, 0.5, 1e-12);
  EXPECT_NEAR(s.f_scores[0].recall, 0.75, 1e-12);
  EXPECT_NEAR(s.f_scores[0].f, 0.6, 1e-12);
  EXPECT_NEAR(s.f_scores[1].f, 1, 1e-12);
  EXPECT_EQ(s.f_scores[2].f, 0);
}

TEST(ScoreSurface, OneClassAlone) {
  const std::vector<MeasuredPoint> points = {At(0.1, 0), At(0.3, 1), At(0.5, -1)};
  EXPECT_NEAR(ScoreSurface(points, points, 0.5, {}, 1).accuracy.mean_m, 0.3, 1e-12);
  EXPECT_NEAR(ScoreSurface(points, points, 0.5, {}).accuracy.mean_m, 0.3, 1e-12);
  EXPECT_EQ(ScoreSurface(points, points, 0.5, {}, 2).accuracy.points, 0);
}

}  // namespace
}  // namespace tessera
