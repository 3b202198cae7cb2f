#include "worker/changes/semi_global.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "common/base/random.h"

namespace tessera {
namespace {

CostVolume RandomCosts(int width, int height, int levels) {
  CostVolume volume(width, height, levels, 0);
  Random random(3);
  for (uint8_t& cost : volume.cost) cost = static_cast<uint8_t>(random.Uniform(0, 100));
  return volume;
}

std::vector<int> Best(const CostVolume& volume, const std::vector<int16_t>& sum) {
  std::vector<int> best;
  for (size_t i = 0; i < sum.size(); i += volume.levels) {
    best.push_back(static_cast<int>(std::min_element(&sum[i], &sum[i] + volume.levels) - &sum[i]));
  }
  return best;
}

// Equation 13 of the paper, implemented literally for one path from left to right.
TEST(SemiGlobal, RowMatchesEquation13) {
  const CostVolume volume = RandomCosts(9, 1, 6);
  const SmoothPenalties penalties{7, 23, 23};
  const auto path = [&](bool reverse) {
    std::vector<std::vector<int>> value(9, std::vector<int>(6));
    for (int k = 0; k < 9; ++k) {
      const int x = reverse ? 8 - k : k, from = reverse ? x + 1 : x - 1;
      for (int d = 0; d < 6; ++d) {
        value[x][d] = volume.At(x, 0)[d];
        if (k == 0) continue;
        const int least = *std::min_element(value[from].begin(), value[from].end());
        int best = least + penalties.more;
        for (int e = 0; e < 6; ++e) {
          best = std::min(best, value[from][e] + (e == d ? 0 : std::abs(e - d) == 1 ? penalties.one_level : 1000));
        }
        value[x][d] += best - least;
      }
    }
    return value;
  };
  const auto right = path(false), left = path(true);
  const std::vector<int16_t> sum = AggregateCosts(volume, {}, penalties);
  for (int x = 0; x < 9; ++x) {
    // The other six paths have length one in a raster of one row.
    for (int d = 0; d < 6; ++d) EXPECT_EQ(sum[x * 6 + d], right[x][d] + left[x][d] + 6 * volume.At(x, 0)[d]);
  }
}

TEST(SemiGlobal, ZeroPenaltiesDecoupleTheCells) {
  const CostVolume volume = RandomCosts(7, 5, 9);
  const std::vector<int16_t> sum = AggregateCosts(volume, {}, {0, 0, 0});
  for (size_t i = 0; i < sum.size(); ++i) EXPECT_EQ(sum[i], 8 * volume.cost[i]);
}

TEST(SemiGlobal, OutliersFollowTheirNeighbours) {
  CostVolume volume(11, 11, 12, 60);
  for (int y = 0; y < 11; ++y) {
    for (int x = 0; x < 11; ++x) volume.At(x, y)[x < 6 ? 3 : 9] = 20;
  }
  volume.At(2, 5)[3] = 60;
  volume.At(2, 5)[10] = 30;
  const std::vector<int> best = Best(volume, AggregateCosts(volume, {}, {8, 40, 40}));
  for (int y = 0; y < 11; ++y) {
    for (int x = 0; x < 11; ++x) EXPECT_EQ(best[y * 11 + x], x < 6 ? 3 : 9) << x << " " << y;
  }
}

TEST(SemiGlobal, JumpsAreCheaperAtEdges) {
  CostVolume volume(2, 1, 8, 100);
  volume.At(0, 0)[1] = 0;
  volume.At(1, 0)[6] = 0;
  const std::vector<int16_t> smooth = AggregateCosts(volume, {}, {8, 40, 10});
  const std::vector<int16_t> edge = AggregateCosts(volume, {0, 1}, {8, 40, 10});
  EXPECT_EQ(smooth[8 + 6] - edge[8 + 6], 30);
}

}  // namespace
}  // namespace tessera
