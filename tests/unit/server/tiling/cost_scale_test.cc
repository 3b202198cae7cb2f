#include "server/tiling/cost_scale.h"

#include <gtest/gtest.h>

namespace tessera {
namespace {

TEST(CostScale, WithoutMeasurementsNothingIsCorrected) {
  EXPECT_EQ(CostScale().Of("measure"), 1);
  EXPECT_EQ(CostScale(MeasuredCosts()).Of("measure"), 1);
  const Prediction same = CostScale().Corrected("cut", {3, 5});
  EXPECT_EQ(same.core_seconds, 3);
  EXPECT_EQ(same.peak_bytes, 5);
}

TEST(CostScale, MeasuredKindsHaveTheirRatioAndOthersTheTotalRatio) {
  const CostScale scale({{"measure", {100, 50}}, {"solve", {20, 25}}, {"cut", {40, 5}}});
  EXPECT_EQ(scale.Of("measure"), 0.5);
  EXPECT_EQ(scale.Of("solve"), 1.25);
  EXPECT_EQ(scale.Of("cut"), 0.125);
  EXPECT_EQ(scale.Of("compare"), 0.5) << "80 / 160";
  const Prediction corrected = scale.Corrected("solve", {8, 1000});
  EXPECT_EQ(corrected.core_seconds, 10);
  EXPECT_EQ(corrected.peak_bytes, 1000) << "the tiling depends on memory";
}

TEST(CostScale, RatiosStayWithinLimits) {
  const CostScale scale({{"measure", {1000, 2}}, {"ingest", {1, 1000}}});
  EXPECT_EQ(scale.Of("measure"), kLeastScale);
  EXPECT_EQ(scale.Of("ingest"), kMostScale);
}

TEST(CostScale, ShortTasksAreNotMeasured) {
  const CostScale scale({{"measure", {100, 50}}, {"publish", {0.1, 0.9}}, {"crop", {0, 4}}});
  EXPECT_NEAR(scale.Of("publish"), 0.55, 0.01) << "ratio of all kinds";
  EXPECT_EQ(scale.Of("crop"), scale.Of("publish")) << "no prediction to compare with";
  EXPECT_EQ(CostScale({{"publish", {0.1, 0.9}}}).Of("publish"), 1) << "all kinds together are too short";
}

}  // namespace
}  // namespace tessera
