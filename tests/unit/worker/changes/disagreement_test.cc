#include "worker/changes/disagreement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "common/job/change_cells.h"
#include "tests/unit/worker/changes/painted_raster.h"
#include "tests/unit/worker/changes/painted_town.h"
#include "worker/changes/measure_changes.h"

namespace tessera {
namespace {

constexpr double kGsd_m = 0.15;
const CellRect kEpochCells{0, 0, 100, 50};

EpochDisagreement Of(const ChangeRaster& raster, std::span<const SurfaceRaster> refined = {}) {
  return MeasureDisagreement(raster, refined, kPaintedRoles, kGsd_m, {});
}

TEST(Disagreement, IsZeroWithoutKnownCells) {
  const EpochDisagreement none = Of(ChangeRaster(kEpochCells, 0.5));
  EXPECT_EQ(none.agreement, 0);
  EXPECT_EQ(none.before.heights, 0);
  EXPECT_EQ(none.before.labels, 0);
  EXPECT_FALSE(none.refined);
  EXPECT_FALSE(none.IsLarge());
}

TEST(Disagreement, IsAShareOfTheKnownCells) {
  ChangeRaster raster = FlatRaster(kEpochCells, 0.5);
  Paint(&raster, {0, 0, 100, 10}, 10, 0, 16, 2);     // a fifth is built
  Paint(&raster, {0, 10, 100, 15}, 10, 0, 10, 3);    // a tenth is planted
  Paint(&raster, {0, 15, 100, 20}, 10, 2, 10, 1);    // a roof now shows its facade
  Paint(&raster, {0, 20, 100, 25}, 10, 0, 11.4, 0);  // below the threshold
  for (float& score : raster.before_score) score = score < 0.5f ? 0.4f : score;
  const EpochDisagreement all = Of(raster);
  EXPECT_NEAR(all.before.heights, 0.2, 1e-9);
  EXPECT_NEAR(all.before.labels, 0.3, 1e-9);
  EXPECT_NEAR(all.agreement, 0.9, 1e-6);
  EXPECT_NEAR(all.agreement_before, 0.9 - 0.3 * 0.5, 1e-6) << "where heights differ, however little";
  EXPECT_TRUE(all.IsLarge());
  // Half of the new building is unknown and has no old surface: 500 of 4,000 cells.
  for (int i = 0; i < 500; ++i) raster.after.height_m[i] = std::numeric_limits<float>::quiet_NaN();
  for (int i = 4500; i < 5000; ++i) raster.before.height_m[i] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_NEAR(Of(raster).before.heights, 500.0 / 4000, 1e-9);
}

TEST(Disagreement, IsSmallerForARefinedMeshThatFollows) {
  ChangeRaster raster = FlatRaster(kEpochCells, 0.5);
  Paint(&raster, {0, 0, 100, 10}, 10, 0, 16, 2);
  const auto left = [&](const SurfaceRaster& refined) { return Of(raster, {&refined, 1}).refined.value(); };
  EXPECT_NEAR(left(raster.before).heights, 0.2, 1e-9);
  EXPECT_NEAR(left(raster.before).labels, 0.2, 1e-9);
  EXPECT_EQ(left(raster.after).heights, 0);
  EXPECT_EQ(left(raster.after).labels, 0);
  // A refined mesh larger than the measured area, in pieces.
  SurfaceRaster low(CellRect{-10, -20, 120, 5}, 0.5), high(CellRect{-10, 5, 120, 60}, 0.5);
  for (SurfaceRaster* part : {&low, &high}) {
    part->height_m.assign(part->size(), part == &low ? 16.0f : 10.0f);
    part->label.assign(part->size(), part == &low ? 2 : 0);
  }
  const SurfaceRaster both[] = {high, low};
  EXPECT_NEAR(Of(raster, both).refined->heights, 0.1, 1e-9);
}

TEST(Disagreement, IsNearZeroForASecondFlightOverTheSameScene) {
  const std::vector<TownBox> houses = {{-14, -13, -6, -4, 6}, {3, -4, 12, 5, 5}};
  const GroundPlane ground = MakeGroundPlane(Eigen::Vector3d::UnitZ(), ChangeCellSize_m(kTownGsd_m));
  MeasureOptions options;
  options.below_m = 3;
  options.above_m = 10;
  const auto measure = [&](const std::vector<TownBox>& now) {
    const ChangeRaster raster = MeasureChanges(PaintedTown(houses), ground, {8, 8, 88, 88},
                                               Photographs(PaintedTown(now), TownFlight()), 4, kTownGsd_m, options);
    return MeasureDisagreement(raster, {}, kPaintedRoles, kTownGsd_m, {});
  };
  const EpochDisagreement same = measure(houses), gone = measure({houses[0]});
  EXPECT_LT(same.before.heights, 0.01);
  EXPECT_LT(same.before.labels, 0.02);
  EXPECT_GT(same.agreement, 0.7);
  EXPECT_LT(same.agreement - same.agreement_before, 0.03);
  // 81 of 1,600 square metres, nearly all of them known.
  EXPECT_NEAR(gone.before.heights, 81.0 / 1600, 0.01);
  EXPECT_NEAR(gone.before.labels, 81.0 / 1600, 0.02);
  EXPECT_GT(gone.agreement - gone.agreement_before, same.agreement - same.agreement_before + 0.02);
  EXPECT_FALSE(gone.IsLarge());
}

}  // namespace
}  // namespace tessera
