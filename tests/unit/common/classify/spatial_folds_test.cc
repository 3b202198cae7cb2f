#include "common/classify/spatial_folds.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "common/base/random.h"

namespace tessera {
namespace {

PixelLocation OnGround(double x, double y, uint32_t view = 0) { return {Eigen::Vector2d(x, y), view, 0, 0}; }

std::vector<PixelLocation> Scattered(int count) {
  std::vector<PixelLocation> pixels;
  Random random(1);
  for (int i = 0; i < count; ++i) pixels.push_back(OnGround(random.Uniform(0, 100), random.Uniform(0, 60), i % 4));
  return pixels;
}

TEST(SpatialFoldsTest, EqualGroundPositionsShareAFoldAcrossImages) {
  const std::vector<PixelLocation> pixels = Scattered(2000);
  const SpatialFolds folds = SpatialFolds::Of(pixels, 4);
  for (PixelLocation pixel : pixels) {
    const int fold = folds.FoldOf(pixel);
    pixel.view += 1;
    pixel.x += 300;
    EXPECT_EQ(folds.FoldOf(pixel), fold);
  }
}

TEST(SpatialFoldsTest, FoldsAreBalanced) {
  const std::vector<PixelLocation> pixels = Scattered(4000);
  const SpatialFolds folds = SpatialFolds::Of(pixels, 4);
  ASSERT_EQ(folds.folds(), 4);
  std::vector<int> filled(4);
  for (const PixelLocation& pixel : pixels) ++filled.at(folds.FoldOf(pixel));
  EXPECT_GT(*std::min_element(filled.begin(), filled.end()), 850);
}

TEST(SpatialFoldsTest, PixelsWithoutMeshUseTheirImagePosition) {
  std::vector<PixelLocation> pixels;
  for (int x = 0; x < 1000; x += 10) pixels.push_back({std::nullopt, 2, x, 40});
  const SpatialFolds folds = SpatialFolds::Of(pixels, 2);
  EXPECT_EQ(folds.folds(), 2);
  EXPECT_EQ(folds.FoldOf({std::nullopt, 2, 20, 60}), folds.FoldOf({std::nullopt, 2, 30, 100}));
  EXPECT_EQ(folds.FoldOf({std::nullopt, 3, 20, 60}), -1) << "another image";
}

TEST(SpatialFoldsTest, UnknownCellsHaveNoFold) {
  EXPECT_EQ(SpatialFolds::Of(Scattered(100), 4).FoldOf(OnGround(5000, 0)), -1);
}

TEST(SpatialFoldsTest, OneCellGivesOneFold) {
  EXPECT_EQ(SpatialFolds::Of(std::vector<PixelLocation>(50, OnGround(3, 3)), 4).folds(), 1);
}

}  // namespace
}  // namespace tessera
