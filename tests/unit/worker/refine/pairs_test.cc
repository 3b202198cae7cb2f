#include "worker/refine/pairs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "common/base/random.h"
#include "tests/unit/worker/refine/relief_scene.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

// A row of cameras above the ground, `spacing` radians apart seen from below.
std::vector<PosedCamera> Fan(int count, double spacing_rad) {
  std::vector<PosedCamera> cameras;
  for (int i = 0; i < count; ++i) {
    const double angle = spacing_rad * (i - 0.5 * (count - 1));
    cameras.push_back(LookAt(20 * Vector3d(std::sin(angle), 0, std::cos(angle)), Vector3d::Zero(), 160, 120, 200));
  }
  return cameras;
}

TEST(Pairs, KeepsToTheAnglesAndIsSymmetric) {
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
  // Every view got as many partners as it asked for.
  for (int i = 0; i < 9; ++i) {
    EXPECT_GE(std::count_if(pairs.begin(), pairs.end(), [&](const ViewPair& p) { return p.reference == i; }), 3);
  }
}

TEST(Pairs, TwinCamerasAreNoPair) {
  const TriangleMesh mesh = HeightField(20, 4, [](double, double) { return 0.0; });
  EXPECT_TRUE(SelectPairs(mesh, Fan(2, 0.01), PairOptions()).empty());
  EXPECT_EQ(SelectPairs(mesh, Fan(2, 0.2), PairOptions()).size(), 2u);
  EXPECT_TRUE(SelectPairs(mesh, Fan(2, 1.2), PairOptions()).empty());
}

TEST(Pairs, ViewsOfDifferentPlacesAreNoPair) {
  const TriangleMesh mesh = HeightField(20, 40, [](double, double) { return 0.0; });
  const std::vector<PosedCamera> cameras = {LookAt({-30, 0, 20}, {-30, 0, 0}, 160, 120, 200),
                                            LookAt({30, 0, 20}, {30, 0, 0}, 160, 120, 200)};
  EXPECT_TRUE(SelectPairs(mesh, cameras, PairOptions()).empty());
}

// Strips of a flight, listed in any order: neighbours come to lie within about a strip of each other.
TEST(Pairs, OrderKeepsNeighboursTogether) {
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
  const std::vector<int> order = OrderByPairs(kViews + 2, pairs);  // and two that nobody is compared with
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
