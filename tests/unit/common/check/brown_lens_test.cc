// A small scene photographed through LensModel::kBrown.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/check/check.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

class BrownLensTest : public testing::Test {
 protected:
  SceneSummary Check() const {
    Warnings warnings;
    const StatusOr<SceneSummary> summary = CheckSceneFolder(folder_, &warnings, {});
    EXPECT_TRUE(summary.ok()) << summary.status();
    return summary.ok() && summary->fit && summary->tie_points ? *summary : SceneSummary();
  }

  const std::string folder_ = FreshTestFolder("brown");
};

TEST_F(BrownLensTest, PhotographsAreUndistorted) {
  TinySceneOptions options;
  options.k1 = -0.1;
  options.k4 = 0.3;
  options.skew_px = 4;
  options.tower = true;
  WriteTinyScene(folder_, options);
  const SceneSummary good = Check();
  ASSERT_TRUE(good.fit.has_value());
  EXPECT_LT(good.tie_points->median_px, 1e-4);
  EXPECT_LT(good.fit->all.across_px, 0.2);
  EXPECT_GT(good.fit->all.above_chance, 0.8);

  // Without skew and r^8 neither points nor pixels fit.
  ReplaceInFile(folder_ + "/colmap/cameras.txt", " 0 0.3 4\n", " 0 0 0.001\n");
  const SceneSummary bad = Check();
  ASSERT_TRUE(bad.fit.has_value());
  EXPECT_GT(bad.tie_points->median_px, 0.3);
  EXPECT_GT(bad.fit->all.across_px, 1.5 * good.fit->all.across_px);
}

}  // namespace
}  // namespace tessera
