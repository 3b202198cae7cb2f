#include "worker/photo/pairs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <set>

#include "common/base/random.h"
#include "tests/support/relief_scene.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

// A row of cameras above the ground, `spacing` radians apart as seen from below.
std::vector<PosedCamera> Fan(int count, double spacing_rad) {
  std::vector<PosedCamera> cameras;
  for (int i = 0; i < count; ++i) {
    const double angle = spacing_rad * (i - 0.5 * (count - 1));
    cameras.push_back(LookAt(20 * Vector3d(std::sin(angle), 0, std::cos(angle)), Vector3d::Zero(), 160, 120, 200));
  }
  return cameras;
}

// A literal implementation of the definition.
std::vector<ViewPair> PlainPairs(const TriangleMesh& mesh, const std::vector<PosedCamera>& cameras,
                                 const PairOptions& options) {
  const size_t step = std::max<size_t>(1, mesh.faces.size() / static_cast<size_t>(options.samples));
  std::vector<size_t> samples;
  for (size_t f = step / 2; f < mesh.faces.size(); f += step) samples.push_back(f);
  const int views = static_cast<int>(cameras.size());
  const auto quality = [&](size_t face, int i, int j) {
    const Vector3d point = (mesh.Corner(face, 0) + mesh.Corner(face, 1) + mesh.Corner(face, 2)) / 3;
    std::array<Vector3d, 2> towards;
    std::array<double, 2> footprint_m;
    for (int k = 0; k < 2; ++k) {
      const PosedCamera& camera = cameras[k == 0 ? i : j];
      const Vector3d pixel = camera.Project(point);
      towards[k] = (camera.Centre() - point).normalized();
      if (!camera.InImage(pixel) || towards[k].dot(FaceNormal(mesh, face)) < 0.15) return 0.0;
      footprint_m[k] = pixel.z() / camera.intrinsics.fx;
    }
    const double angle = std::acos(std::clamp(towards[0].dot(towards[1]), -1.0, 1.0));
    const double scale = std::max(footprint_m[0] / footprint_m[1], footprint_m[1] / footprint_m[0]);
    if (angle < options.min_angle_rad || angle > options.max_angle_rad || scale > options.max_scale_ratio) return 0.0;
    const double spread = angle < options.best_angle_rad ? options.best_angle_rad / 2 : options.best_angle_rad;
    const double t = (angle - options.best_angle_rad) / spread;
    return std::exp(-0.5 * t * t) / (scale * scale);
  };
  std::set<std::pair<int, int>> pairs;
  for (int i = 0; i < views; ++i) {
    std::vector<double> covered(samples.size(), 0);
    std::set<int> chosen;
    while (static_cast<int>(chosen.size()) < options.partners) {
      int best = -1;
      double best_gain = 1e-3 * static_cast<double>(samples.size()) / views;
      for (int j = 0; j < views; ++j) {
        if (j == i || chosen.contains(j)) continue;
        double gain = 0;
        for (size_t s = 0; s < samples.size(); ++s) gain += quality(samples[s], i, j) / (1 + 2 * covered[s]);
        if (gain > best_gain) {
          best_gain = gain;
          best = j;
        }
      }
      if (best < 0) break;
      for (size_t s = 0; s < samples.size(); ++s) covered[s] += quality(samples[s], i, best);
      chosen.insert(best);
      pairs.insert({i, best});
      pairs.insert({best, i});
    }
  }
  std::vector<ViewPair> out;
  for (const auto& [i, j] : pairs) out.push_back({i, j});
  return out;
}

TEST(Pairs, RespectsTheAngleLimitsAndIsSymmetric) {
  const TriangleMesh mesh = HeightField(20, 4, [](double, double) { return 0.0; });
  const std::vector<PosedCamera> cameras = Fan(9, 0.15);
  PairOptions options;
  const std::vector<ViewPair> pairs = SelectPairs(mesh, cameras, options);
  ASSERT_FALSE(pairs.empty());
  for (const ViewPair& pair : pairs) {
    EXPECT_LT(0.15 * std::abs(pair.reference - pair.other), options.max_angle_rad + 0.15);
    EXPECT_NE(std::find(pairs.begin(), pairs.end(), ViewPair{pair.other, pair.reference}), pairs.end());
  }
  EXPECT_TRUE(std::is_sorted(pairs.begin(), pairs.end(), [](const ViewPair& a, const ViewPair& b) {
    return a.reference != b.reference ? a.reference < b.reference : a.other < b.other;
  }));
  EXPECT_EQ(SelectPairs(mesh, cameras, options), pairs);
  // Every view has as many partners as requested.
  for (int i = 0; i < 9; ++i) {
    EXPECT_GE(std::count_if(pairs.begin(), pairs.end(), [&](const ViewPair& p) { return p.reference == i; }), 3);
  }
}

TEST(Pairs, MatchThePlainImplementation) {
  Random random(7);
  size_t pairs = 0;
  for (int round = 0; round < 6; ++round) {
    TriangleMesh mesh;
    for (int f = 0; f < 60; ++f) {
      const auto at = [&] { return 0.5 * static_cast<double>(random.Below(100)); };
      const Vector3d corner(at(), at(), 0.1 * at());
      const auto first = static_cast<uint32_t>(mesh.vertices.size());
      mesh.vertices.insert(mesh.vertices.end(),
                           {corner, corner + Vector3d(2, 0, 0.02 * at()), corner + Vector3d(0, 2, 0)});
      mesh.faces.push_back({first, first + 1, first + 2});
    }
    std::vector<PosedCamera> cameras;
    for (int i = 0; i < 24; ++i) {
      PosedCamera camera;
      camera.intrinsics = {100, 100, 80, 60, 160, 120};
      camera.rotation_cam_from_world = Vector3d(1, -1, -1).asDiagonal();
      // Some cameras share a centre and have equal scores.
      const Vector3d centre(10.0 * random.Below(6), 10.0 * random.Below(6), 20.0 + 8 * random.Below(3));
      camera.translation_cam_from_world = -(camera.rotation_cam_from_world * centre);
      cameras.push_back(camera);
    }
    const std::vector<ViewPair> found = SelectPairs(mesh, cameras, PairOptions()),
                                expected = PlainPairs(mesh, cameras, PairOptions());
    EXPECT_EQ(found, expected);
    pairs += found.size();
  }
  EXPECT_GT(pairs, 200u);
}

TEST(Pairs, CamerasWithEqualCentresAreNotPaired) {
  const TriangleMesh mesh = HeightField(20, 4, [](double, double) { return 0.0; });
  EXPECT_TRUE(SelectPairs(mesh, Fan(2, 0.01), PairOptions()).empty());
  EXPECT_EQ(SelectPairs(mesh, Fan(2, 0.2), PairOptions()).size(), 2u);
  EXPECT_TRUE(SelectPairs(mesh, Fan(2, 1.2), PairOptions()).empty());
}

TEST(Pairs, ViewsWithoutOverlapAreNotPaired) {
  const TriangleMesh mesh = HeightField(20, 40, [](double, double) { return 0.0; });
  const std::vector<PosedCamera> cameras = {LookAt({-30, 0, 20}, {-30, 0, 0}, 160, 120, 200),
                                            LookAt({30, 0, 20}, {30, 0, 0}, 160, 120, 200)};
  EXPECT_TRUE(SelectPairs(mesh, cameras, PairOptions()).empty());
}

// Flight strips listed in any order: paired views end up within about a strip of each other.
TEST(Pairs, OrderKeepsPairsClose) {
  constexpr int kSide = 12, kViews = kSide * kSide;
  std::vector<int> shuffled(kViews);
  std::iota(shuffled.begin(), shuffled.end(), 0);
  Random random(3);
  for (size_t i = shuffled.size(); i > 1; --i) std::swap(shuffled[i - 1], shuffled[random.Below(i)]);
  std::vector<ViewPair> pairs;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      for (const auto& [dx, dy] : {std::array{1, 0}, std::array{0, 1}}) {
        if (x + dx >= kSide || y + dy >= kSide) continue;
        const int a = shuffled[y * kSide + x], b = shuffled[(y + dy) * kSide + x + dx];
        pairs.push_back({a, b});
        pairs.push_back({b, a});
      }
    }
  }
  const std::vector<int> order = OrderByPairs(kViews + 2, pairs);  // and two views without pairs
  std::vector<int> place(order.size(), -1);
  for (size_t i = 0; i < order.size(); ++i) place[order[i]] = static_cast<int>(i);
  EXPECT_EQ(std::count(place.begin(), place.end(), -1), 0) << "each view once";
  int farthest = 0;
  for (const ViewPair& pair : pairs) farthest = std::max(farthest, std::abs(place[pair.reference] - place[pair.other]));
  EXPECT_LE(farthest, kSide + 2);
  EXPECT_EQ(order, OrderByPairs(kViews + 2, pairs));
}

}  // namespace
}  // namespace tessera
