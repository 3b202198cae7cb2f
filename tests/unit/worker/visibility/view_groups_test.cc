#include "worker/visibility/view_groups.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "common/base/random.h"

namespace tessera {
namespace {

// Compares with the definition for sparse and dense flags, several margins and map sizes.
TEST(KeepNearOwn, KeepsExactlyThePixelsWithinTheMargin) {
  Random random(7);
  int64_t kept = 0, dropped = 0;
  for (int run = 0; run < 60; ++run) {
    FaceMap map;
    map.width = 1 + static_cast<int>(random.Below(40));
    map.height = 1 + static_cast<int>(random.Below(40));
    const int margin = static_cast<int>(random.Below(8)), faces = 50;
    std::vector<uint8_t> own(faces, 0);
    for (uint8_t& flag : own) flag = random.Uniform() < 0.02 * run / 60.0;
    own[0] = 1;
    for (int i = 0; i < map.width * map.height; ++i) {
      const double kind = random.Uniform();
      map.face.push_back(kind < 0.1   ? -1
                         : kind < 0.2 ? kNotSelected
                                      : static_cast<int32_t>(1 + random.Below(faces - 1)));
      map.depth.push_back(1);
    }
    if (run % 2 == 0) map.face[random.Below(map.face.size())] = 0;
    const FaceMap before = map;
    KeepNearOwn(own, margin, &map);
    for (int y = 0; y < map.height; ++y) {
      for (int x = 0; x < map.width; ++x) {
        bool near = false;
        for (int v = std::max(0, y - margin); v <= std::min(map.height - 1, y + margin); ++v) {
          for (int u = std::max(0, x - margin); u <= std::min(map.width - 1, x + margin); ++u) {
            const int32_t face = before.face[v * map.width + u];
            near = near || (face >= 0 && own[face] != 0);
          }
        }
        const int at = y * map.width + x;
        ASSERT_EQ(map.face[at], near ? before.face[at] : -1) << "run " << run << " at " << x << ", " << y;
        ++(near ? kept : dropped);
      }
    }
    EXPECT_EQ(map.depth, before.depth);
  }
  EXPECT_GT(kept, 1000);
  EXPECT_GT(dropped, 1000);
}

}  // namespace
}  // namespace tessera
