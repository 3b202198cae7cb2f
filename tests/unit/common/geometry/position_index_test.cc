#include "common/geometry/position_index.h"

#include <gtest/gtest.h>

#include "common/base/random.h"

namespace tessera {
namespace {

TEST(PositionIndex, EqualPositionsHaveOneNumber) {
  PositionIndex index;
  EXPECT_EQ(index.NumberOf({0, 1, 2}), 0u);
  EXPECT_EQ(index.NumberOf({0, 1, 2 + 1e-15}), 1u);
  EXPECT_EQ(index.NumberOf({-0.0, 1, 2}), 0u);
  EXPECT_EQ(index.NumberOf({1, 0, 2}), 2u);
  EXPECT_EQ(index.positions().size(), 3u);
  EXPECT_EQ(index.positions()[2], Eigen::Vector3d(1, 0, 2));
}

TEST(PositionIndex, GrowsWithoutChangingNumbers) {
  PositionIndex index;
  Random random(1);
  std::vector<Eigen::Vector3d> positions;
  for (uint32_t k = 0; k < 5000; ++k) {
    positions.emplace_back(random.Uniform(), 5e6 + random.Uniform(), 0);
    ASSERT_EQ(index.NumberOf(positions.back()), k);
  }
  for (uint32_t k = 0; k < 5000; ++k) ASSERT_EQ(index.NumberOf(positions[k]), k);
  EXPECT_EQ(index.positions(), positions);
}

}  // namespace
}  // namespace tessera
