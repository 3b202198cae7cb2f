#include "server/tiling/crop_groups.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "tests/support/small_surveys.h"

namespace tessera {
namespace {

using testing::ElementsAre;

constexpr int64_t kMaxPeak_bytes = int64_t{1} << 30;

// Square cameras of this many pixels.
Survey SurveyWithImages(int views, int size_px) {
  Survey survey;
  survey.views.resize(views);
  for (SceneView& view : survey.views) view.camera.intrinsics.width = view.camera.intrinsics.height = size_px;
  return survey;
}

// A tile in all of whose views `share` of the image is cropped.
TileWork WorkOf(const Survey& survey, std::vector<int32_t> views, double share) {
  TileWork work;
  work.core_faces = 1000;
  work.visible_faces = 5000;
  for (const int32_t v : views) {
    const double whole = std::pow(survey.views[v].camera.intrinsics.width, 2);
    work.image_pixels += whole;
    work.pixels += share * whole;
    work.largest_crop = std::max(work.largest_crop, share * whole);
    work.largest_decoded = std::max(work.largest_decoded, 4 * whole);
  }
  work.views = std::move(views);
  work.likelihood_planes = 3;
  return work;
}

TEST(CropGroups, ViewOfSeveralTilesIsDecodedOnce) {
  const Survey survey = SurveyWithImages(4, 1000);
  const TileWork a = WorkOf(survey, {0, 1, 2}, 0.4), b = WorkOf(survey, {1, 2, 3}, 0.4);
  const std::vector<CropGroup> groups = CropGroupsOf(survey, {{3, &a}, {5, &b}}, kMaxPeak_bytes);
  ASSERT_EQ(groups.size(), 1u);
  EXPECT_THAT(groups[0].tiles, ElementsAre(3, 5));
  EXPECT_THAT(groups[0].work.views, ElementsAre(0, 1, 2, 3));
  EXPECT_EQ(groups[0].work.image_pixels, 4e6);
  EXPECT_DOUBLE_EQ(groups[0].work.pixels, 2.4e6);
  const double alone = PredictCrop(a).core_seconds + PredictCrop(b).core_seconds;
  EXPECT_LT(PredictCrop(groups[0].work).core_seconds, 0.95 * alone);
  EXPECT_DOUBLE_EQ(2 * ShareOfCrop(groups[0], false).core_seconds, PredictCrop(groups[0].work).core_seconds);
}

TEST(CropGroups, OnlyTileHasItsOwnPrediction) {
  const Survey survey = SurveyWithImages(2, 1000);
  const TileWork work = WorkOf(survey, {0, 1}, 0.4);
  const std::vector<CropGroup> groups = CropGroupsOf(survey, {{7, &work}}, kMaxPeak_bytes);
  ASSERT_EQ(groups.size(), 1u);
  EXPECT_THAT(groups[0].tiles, ElementsAre(7));
  EXPECT_EQ(PredictCrop(groups[0].work).stored_bytes, PredictCrop(work).stored_bytes);
  EXPECT_EQ(PredictCrop(groups[0].work).peak_bytes, PredictCrop(work).peak_bytes);
}

TEST(CropGroups, TileMemoryBoundsTheirTask) {
  JobSettings settings;
  EXPECT_EQ(MaxCropGroupPeak_bytes(settings), kMaxPeak_bytes);
  settings.tile_memory_bytes = int64_t{600} << 20;
  EXPECT_LT(MaxCropGroupPeak_bytes(settings), settings.tile_memory_bytes);
  settings.tile_memory_bytes = int64_t{8} << 30;
  EXPECT_EQ(MaxCropGroupPeak_bytes(settings), kMaxPeak_bytes);
}

// Many small images exceed the bound on stored crops, a few large ones the bound on memory.
TEST(CropGroups, LargeGroupsAreDivided) {
  for (const auto& [size_px, views_a_tile] : {std::pair(4000, 20), std::pair(9000, 2)}) {
    const Survey survey = SurveyWithImages(12 * views_a_tile, size_px);
    std::vector<TileWork> works;
    std::vector<CroppedTile> tiles;
    for (int t = 0; t < 12; ++t) {
      std::vector<int32_t> views;
      for (int v = 0; v < views_a_tile; ++v) views.push_back(t * views_a_tile + v);
      works.push_back(WorkOf(survey, views, 0.3));
    }
    for (int t = 0; t < 12; ++t) tiles.push_back({t, &works[t]});
    const std::vector<CropGroup> groups = CropGroupsOf(survey, tiles, kMaxPeak_bytes);
    EXPECT_GT(groups.size(), 2u);
    int next = 0;
    for (const CropGroup& group : groups) {
      for (const int tile : group.tiles) EXPECT_EQ(tile, next++);
      if (group.tiles.size() == 1) continue;
      EXPECT_LE(PredictCrop(group.work).stored_bytes, kMaxCropGroupBytes);
      EXPECT_LE(PredictCrop(group.work).peak_bytes, kMaxPeak_bytes);
    }
    EXPECT_EQ(next, 12);
  }
}

}  // namespace
}  // namespace tessera
