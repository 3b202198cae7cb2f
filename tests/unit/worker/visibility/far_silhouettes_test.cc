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

std::vector<uint8_t> Flags(const std::vector<PixelRun>& runs, int pixels) {
  std::vector<uint8_t> flags(pixels);
  uint32_t end = 0;
  for (const PixelRun& run : runs) {
    EXPECT_LT(run.first, run.last);
    EXPECT_TRUE(end == 0 || run.first > end) << "in order, never touching";
    end = run.last;
    for (uint32_t i = run.first; i < run.last; ++i) flags[i] = 1;
  }
  return flags;
}

// Pixels within `radius` of one whose neighbour to a side lies farther off than `reach_m`, by the definition.
std::vector<uint8_t> ByDefinition(const FaceMap& map, const PosedCamera& camera, const Vector3d& up, double reach_m,
                                  int level, int radius) {
  const auto apart = [&](int x, int y, int u, int v) {
    const float a = map.depth[y * map.width + x], b = map.depth[v * map.width + u];
    if (std::isinf(a) || std::isinf(b)) return std::isinf(a) != std::isinf(b);
    const Vector3d d =
        a * camera.Ray(map.x0 + x + 0.5, map.y0 + y + 0.5) - b * camera.Ray(map.x0 + u + 0.5, map.y0 + v + 0.5);
    return (d - up * up.dot(d)).norm() > reach_m;
  };
  const int width = map.width >> level, height = map.height >> level;
  std::vector<uint8_t> out(width * height);
  for (int y = 0; y < height << level; ++y) {
    for (int x = 0; x < width << level; ++x) {
      const bool passes = (x > 0 && apart(x, y, x - 1, y)) || (x + 1 < map.width && apart(x, y, x + 1, y)) ||
                          (y > 0 && apart(x, y, x, y - 1)) || (y + 1 < map.height && apart(x, y, x, y + 1));
      if (!passes) continue;
      for (int v = 0; v < height; ++v) {
        for (int u = 0; u < width; ++u) {
          if (std::abs(u - (x >> level)) <= radius && std::abs(v - (y >> level)) <= radius) out[v * width + u] = 1;
        }
      }
    }
  }
  return out;
}

TEST(FarSilhouettes, AreWhereTheDefinitionHasThem) {
  const PosedCamera camera = LookingDown();
  Random random(4);
  int marked = 0;
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
    const FarSilhouettes silhouettes(map, camera, up, 1.5);
    for (int level : {0, 1, 2}) {
      for (int radius : {0, 3}) {
        const std::vector<uint8_t> expected = ByDefinition(map, camera, up, 1.5, level, radius);
        const int pixels = (kWidth >> level) * (kHeight >> level);
        ASSERT_EQ(Flags(silhouettes.Near(level, radius), pixels), expected) << level << ' ' << radius;
        for (uint8_t flag : expected) marked += flag;
      }
    }
  }
  EXPECT_GT(marked, 1000);
}

// A step along `up` parts nothing, however high: what lies over the same ground is in the same tile.
TEST(FarSilhouettes, StepsOfHeightAreNear) {
  FaceMap map = MapOfDepth(100);
  map.depth[kHeight / 2 * kWidth + kWidth / 2] = 80;
  EXPECT_TRUE(FarSilhouettes(map, LookingDown(), -Vector3d::UnitZ(), 5).Near(0, 0).empty());
  // The same step across another direction than its own.
  EXPECT_FALSE(FarSilhouettes(map, LookingDown(), Vector3d::UnitX(), 5).Near(0, 0).empty());
}

TEST(FarSilhouettes, BlindPixelsKeepTheirFaces) {
  FaceMap map = MapOfDepth(1);
  map.face[7] = 12;
  map.face[8] = -1;
  MarkBlind(std::vector<PixelRun>{{6, 9}}, &map);
  EXPECT_LT(map.face[6], -1);
  EXPECT_EQ(Blinded(map.face[6]), 0);
  EXPECT_EQ(Blinded(map.face[7]), 12);
  EXPECT_EQ(map.face[8], -1);
  EXPECT_EQ(map.face[9], 0);
  EXPECT_EQ(map.depth[7], 1);
}

}  // namespace
}  // namespace tessera
