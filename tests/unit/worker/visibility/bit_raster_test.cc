#include "worker/visibility/bit_raster.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <utility>
#include <vector>

#include "common/base/random.h"

namespace tessera {
namespace {

// Compares with a flag a column, for ranges within words and over their borders.
TEST(BitRaster, EqualsAFlagAColumn) {
  Random random(3);
  int met = 0, missed = 0;
  for (int run = 0; run < 200; ++run) {
    const int width = 1 + static_cast<int>(random.Below(300)), height = 1 + static_cast<int>(random.Below(3));
    BitRaster raster(width, height);
    std::vector<std::vector<int>> rows(height, std::vector<int>(width, 0));
    const auto range = [&](int longest) {
      const auto x0 = static_cast<int>(random.Below(width));
      return std::pair(x0, std::min(width, x0 + 1 + static_cast<int>(random.Below(longest))));
    };
    for (int i = 0; i < 4; ++i) {
      const auto y = static_cast<int>(random.Below(height));
      const auto [x0, x1] = range(run % 2 == 0 ? 5 : 150);
      raster.Set(y, x0, x1);
      std::fill(rows[y].begin() + x0, rows[y].begin() + x1, 1);
    }
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        ASSERT_EQ(static_cast<int>(raster.row(y)[x / 64] >> (x % 64) & 1), rows[y][x]) << x;
      }
      for (int i = 0; i < 20; ++i) {
        const auto [x0, x1] = range(i % 2 == 0 ? 5 : 150);
        const bool meets = std::find(rows[y].begin() + x0, rows[y].begin() + x1, 1) != rows[y].begin() + x1;
        ASSERT_EQ(raster.Meets(y, x0, x1), meets) << x0 << " to " << x1;
        ++(meets ? met : missed);
      }
    }
  }
  EXPECT_GT(met, 500);
  EXPECT_GT(missed, 500);
}

TEST(Widen, SetsWhatIsNearASetBit) {
  Random random(4);
  constexpr int kWidth = 256;
  for (const int distance : {0, 1, 2, 3, 6, 10, 63, 64, 65, 100}) {
    BitRaster raster(kWidth, 1);
    std::vector<int> set;
    for (int i = 0; i < 3; ++i) set.push_back(static_cast<int>(random.Below(kWidth)));
    for (const int x : set) raster.Set(0, x, x + 1);
    Widen(raster.row(0), distance);
    for (int x = 0; x < kWidth; ++x) {
      const bool near = std::any_of(set.begin(), set.end(), [&](int s) { return std::abs(x - s) <= distance; });
      ASSERT_EQ(raster.row(0)[x / 64] >> (x % 64) & 1, near ? 1u : 0u) << distance << " at " << x;
    }
  }
}

}  // namespace
}  // namespace tessera
