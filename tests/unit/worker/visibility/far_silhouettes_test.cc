#include "worker/visibility/far_silhouettes.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/base/random.h"
#include "worker/visibility/view_groups.h"

namespace tessera {
namespace {

using Eigen::Vector3d;

constexpr int kWidth = 48, kHeight = 40;

PosedCamera LookingDown() {
  PosedCamera camera;
  camera.intrinsics = {kWidth, kHeight, 40, 40, kWidth / 2.0, kHeight / 2.0};
  return camera;
}

FaceMap MapOfDepth(float depth) {
  FaceMap map;
  map.width = kWidth;
  map.height = kHeight;
  map.face.assign(kWidth * kHeight, 0);
  map.depth.assign(kWidth * kHeight, depth);
  return map;
}

// The least limit of the pixels within `radius` of each one whose neighbour to a side lies farther off than `reach_m`,
// by the definition.
std::vector<BlindPixel> ByDefinition(const FaceMap& map, const PosedCamera& camera, const Vector3d& up, double reach_m,
                                     int level, const PixelRect& rect, int radius) {
  const auto depth = [&](int x, int y) { return map.depth[y * map.width + x]; };
  const auto apart = [&](int x, int y, int u, int v) {
    const float a = depth(x, y), b = depth(u, v);
    if (std::isinf(a) || std::isinf(b)) return std::isinf(a) != std::isinf(b);
    const Vector3d d =
        a * camera.Ray(map.x0 + x + 0.5, map.y0 + y + 0.5) - b * camera.Ray(map.x0 + u + 0.5, map.y0 + v + 0.5);
    return (d - up * up.dot(d)).norm() > reach_m;
  };
  std::vector<BlindPixel> out;
  for (int v = rect.y0; v < rect.y1; ++v) {
    for (int u = rect.x0; u < rect.x1; ++u) {
      float limit = FaceMap::kNothing;
      for (int y = 0; y < map.height; ++y) {
        for (int x = 0; x < map.width; ++x) {
          if (std::abs(u - ((map.x0 + x) >> level)) > radius || std::abs(v - ((map.y0 + y) >> level)) > radius)
            continue;
          constexpr int kSides[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
          for (const auto& [dx, dy] : kSides) {
            const int nx = x + dx, ny = y + dy;
            if (nx < 0 || ny < 0 || nx >= map.width || ny >= map.height || !apart(x, y, nx, ny)) continue;
            limit = std::min(limit, std::min(depth(x, y), depth(nx, ny)) + static_cast<float>(reach_m / 3));
          }
        }
      }
      const int at = (v - rect.y0) * rect.width() + u - rect.x0;
      if (limit < FaceMap::kNothing) out.push_back({static_cast<uint32_t>(at), limit});
    }
  }
  return out;
}

TEST(FarSilhouettes, AreWhereTheDefinitionHasThem) {
  const PosedCamera camera = LookingDown();
  Random random(4);
  size_t marked = 0;
  for (int round = 0; round < 6; ++round) {
    FaceMap map = MapOfDepth(10);
    map.x0 = static_cast<int>(random.Below(30));
    for (int k = 0; k < 4; ++k) {
      const int x0 = static_cast<int>(random.Below(kWidth)), y0 = static_cast<int>(random.Below(kHeight));
      const float depth = k == 0 ? FaceMap::kNothing : static_cast<float>(random.Uniform(2, 10));
      for (int y = y0; y < std::min(kHeight, y0 + 9); ++y) {
        for (int x = x0; x < std::min(kWidth, x0 + 7); ++x) map.depth[y * kWidth + x] = depth;
      }
    }
    const Vector3d up = Vector3d(0.2, -0.3, -1).normalized();
    const FarSilhouettes silhouettes = FindFarSilhouettes(map, camera, up, 1.5);
    for (int level : {0, 1, 2}) {
      for (int radius : {0, 3}) {
        // Not all of the window, and some beside it.
        const PixelRect rect = {(map.x0 >> level) - 2, 3, (map.x0 + kWidth) >> level, kHeight >> level};
        const std::vector<BlindPixel> expected = ByDefinition(map, camera, up, 1.5, level, rect, radius);
        ASSERT_EQ(silhouettes.Near(level, rect, radius), expected) << level << ' ' << radius;
        marked += expected.size();
      }
    }
  }
  EXPECT_GT(marked, 1000u);
}

// A step along `up` parts nothing, however high: what lies over the same ground is in the same tile.
TEST(FarSilhouettes, StepsOfHeightAreNear) {
  FaceMap map = MapOfDepth(100);
  map.depth[kHeight / 2 * kWidth + kWidth / 2] = 80;
  EXPECT_TRUE(FindFarSilhouettes(map, LookingDown(), -Vector3d::UnitZ(), 5).passing.empty());
  // The same step across another direction than its own.
  EXPECT_FALSE(FindFarSilhouettes(map, LookingDown(), Vector3d::UnitX(), 5).passing.empty());
}

TEST(FarSilhouettes, WhatIsBehindIsBlindAndKeepsItsFace) {
  FaceMap map = MapOfDepth(2);
  map.face[7] = 12;
  map.face[8] = -1;
  MarkBlind(std::vector<BlindPixel>{{6, 1}, {7, 1.5f}, {8, 1}, {9, 3}}, &map);
  EXPECT_LT(map.face[6], -1);
  EXPECT_EQ(Blinded(map.face[6]), 0);
  EXPECT_EQ(Blinded(map.face[7]), 12);
  EXPECT_EQ(map.face[8], kNotLookedAt);
  EXPECT_EQ(map.face[9], 0) << "in front";
  EXPECT_EQ(map.face[10], 0);
  EXPECT_EQ(map.depth[7], 2);
}

}  // namespace
}  // namespace tessera
