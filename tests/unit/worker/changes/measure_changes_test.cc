// Heights and labels measured in rendered images of a synthetic town.
#include "worker/changes/measure_changes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "common/base/parallel.h"
#include "tests/unit/worker/changes/painted_town.h"
#include "worker/changes/change_areas.h"

namespace tessera {
namespace {

const std::vector<ClassRole> kRoles = {ClassRole::kGround, ClassRole::kBuilding, ClassRole::kBuilding,
                                       ClassRole::kVegetation};
const TownBox kHouse{-14, -13, -6, -4, 6};  // stands before and after
const TownBox kNewHouse{3, -4, 12, 5, 5};   // 81 m2
const CellRect kCells{8, 8, 88, 88};        // of 0.5 m

MeasureOptions LowSweep() {
  MeasureOptions options;
  options.below_m = 3;
  options.above_m = 10;
  options.above_roofs_m = 4;
  return options;
}

GroundPlane Ground() { return MakeGroundPlane(Eigen::Vector3d::UnitZ(), ChangeCellSize_m(kTownGsd_m)); }

ChangeRaster Measure(const TriangleMesh& old_mesh, const std::vector<ChangeView>& views, const CellRect& cells = kCells,
                     int classes = 4) {
  return MeasureChanges(old_mesh, Ground(), cells, views, classes, kTownGsd_m, LowSweep());
}

std::vector<ChangeArea> Areas(const ChangeRaster& raster) {
  return FindChangeAreas({&raster, 1}, {}, kRoles, kTownGsd_m, {});
}

bool SameBytes(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

bool Same(const ChangeRaster& a, const ChangeRaster& b) {
  return a.cells() == b.cells() && SameBytes(a.before.height_m, b.before.height_m) &&
         SameBytes(a.after.height_m, b.after.height_m) && a.before.label == b.before.label &&
         a.after.label == b.after.label && SameBytes(a.after_score, b.after_score) &&
         SameBytes(a.before_score, b.before_score) && SameBytes(a.label_margin, b.label_margin);
}

TEST(MeasureChanges, CellsArePowersOfTwoOfThreeToFiveGsd) {
  EXPECT_EQ(ChangeCellSize_m(0.3), 1.0);
  EXPECT_EQ(ChangeCellSize_m(0.13), 0.5);
  for (double gsd_m = 0.02; gsd_m < 1; gsd_m *= 1.07) {
    EXPECT_GE(ChangeCellSize_m(gsd_m), 2.4 * gsd_m);
    EXPECT_LE(ChangeCellSize_m(gsd_m), 5 * gsd_m);
  }
}

TEST(MeasureChanges, FindsANewHouseWithItsHeight) {
  const ChangeRaster raster =
      Measure(PaintedTown({kHouse}), Photographs(PaintedTown({kHouse, kNewHouse}), TownFlight()));
  const std::vector<ChangeArea> areas = Areas(raster);
  ASSERT_EQ(areas.size(), 1u);
  EXPECT_EQ(areas[0].kind, ChangeKind::kBuilt);
  EXPECT_NEAR(areas[0].height_difference_m, 5, 0.4);
  EXPECT_NEAR(areas[0].area_m2, 81, 16);
  EXPECT_NEAR(areas[0].place.x(), kTownMiddle.x() + 7.5, 0.5);
  EXPECT_NEAR(areas[0].place.y(), kTownMiddle.y() + 0.5, 0.5);
  EXPECT_EQ(areas[0].label_before, 0);
  EXPECT_EQ(areas[0].label_after, 2);
}

TEST(MeasureChanges, FindsALostHouseAndALostTree) {
  TownBox tree{2, 5, 9, 12, 7};
  tree.top_label = 3;
  const ChangeRaster raster = Measure(PaintedTown({kHouse, tree}), Photographs(PaintedTown({}), TownFlight()));
  const std::vector<ChangeArea> areas = Areas(raster);
  ASSERT_EQ(areas.size(), 2u);
  EXPECT_EQ(areas[0].kind, ChangeKind::kDemolished);
  EXPECT_NEAR(areas[0].height_difference_m, -6, 0.4);
  EXPECT_NEAR(areas[0].area_m2, 72, 14);
  EXPECT_EQ(areas[1].kind, ChangeKind::kFelled);
  EXPECT_NEAR(areas[1].height_difference_m, -7, 0.4);
}

TEST(MeasureChanges, FindsNothingWhereNothingChanged) {
  const TriangleMesh town = PaintedTown({kHouse, kNewHouse});
  const ChangeRaster raster = Measure(town, Photographs(town, TownFlight()));
  EXPECT_TRUE(Areas(raster).empty());
  int known = 0, moved = 0;
  for (size_t i = 0; i < raster.before.size(); ++i) {
    if (std::isnan(raster.after.height_m[i])) continue;
    ++known;
    moved += std::abs(raster.after.height_m[i] - raster.before.height_m[i]) > 0.6;
  }
  EXPECT_GT(known, 5000);
  EXPECT_LT(moved, known / 50);
}

TEST(MeasureChanges, FindsAChangeOfClassWithoutAChangeOfHeight) {
  TriangleMesh before = PaintedTown({kHouse}), after = before;
  AddQuad(&after, {28, 20, 0.01}, {36, 20, 0.01}, {36, 29, 0.01}, {28, 29, 0.01}, 3);
  const ChangeRaster raster = Measure(before, Photographs(after, TownFlight()));
  const std::vector<ChangeArea> areas = Areas(raster);
  ASSERT_EQ(areas.size(), 1u);
  EXPECT_EQ(areas[0].kind, ChangeKind::kLabel);
  EXPECT_EQ(areas[0].label_before, 0);
  EXPECT_EQ(areas[0].label_after, 3);
  EXPECT_NEAR(areas[0].area_m2, 72, 10);
  EXPECT_NEAR(areas[0].height_difference_m, 0, 0.1);
  EXPECT_EQ(areas[0].volume_m3, 0);
}

TEST(MeasureChanges, WorksWithoutLikelihoods) {
  TriangleMesh before = PaintedTown({kHouse});
  before.labels.clear();
  const ChangeRaster raster =
      Measure(before, Photographs(PaintedTown({kHouse, kNewHouse}), TownFlight(), 0), kCells, 0);
  const std::vector<ChangeArea> areas = Areas(raster);
  ASSERT_EQ(areas.size(), 1u);
  EXPECT_EQ(areas[0].kind, ChangeKind::kBuilt);
  EXPECT_EQ(areas[0].label_before, kNoLabel);
}

TEST(MeasureChanges, CellsSeenByOneViewAreUnknown) {
  const TriangleMesh town = PaintedTown({kNewHouse});
  const ChangeRaster alone = Measure(PaintedTown({}), Photographs(town, {Overhead(0, 0)}));
  for (const float h : alone.after.height_m) EXPECT_TRUE(std::isnan(h));
  EXPECT_TRUE(Areas(alone).empty());
  // Two overlapping views: cells outside the overlap are unknown and no change.
  const ChangeRaster two = Measure(PaintedTown({}), Photographs(PaintedTown({}), {Overhead(-10, 0), Overhead(10, 0)}));
  const auto at = [&](double x, double y) {
    return two.after.height_m[static_cast<size_t>((y + 20) / 0.5) * 80 + static_cast<size_t>((x + 20) / 0.5)];
  };
  EXPECT_FALSE(std::isnan(at(0, 0)));
  EXPECT_TRUE(std::isnan(at(-18, 0)));
  EXPECT_TRUE(std::isnan(at(18, 0)));
  EXPECT_TRUE(Areas(two).empty());
}

TEST(MeasureChanges, OccludedGroundIsUnknown) {
  // All cameras are on the left, so the ground to the right of the tower is visible in none.
  const TriangleMesh town = PaintedTown({{0, -10, 3, 10, 12}});
  const std::vector<ChangeView> views = Photographs(town, {Overhead(-14, -6), Overhead(-14, 6), Overhead(-18, 0)});
  const ChangeRaster raster = Measure(town, views);
  const auto at = [&](double x, double y) {
    return raster.after.height_m[static_cast<size_t>((y + 20) / 0.5) * 80 + static_cast<size_t>((x + 20) / 0.5)];
  };
  for (double y = -7.8; y < 8; y += 0.5) {
    for (double x = 3.8; x < 5.5; x += 0.5) EXPECT_TRUE(std::isnan(at(x, y))) << x << " " << y << " " << at(x, y);
  }
  EXPECT_NEAR(at(-3, 0.2), 0, 0.3);
  EXPECT_TRUE(Areas(raster).empty());
}

TEST(MeasureChanges, OldSurfaceVisibleInOneViewOnlyIsNotDemolished) {
  // Both views see the ground, but the roof, which is nearer, would be outside the left view's image.
  const TownBox tower{9, -5, 13, 5, 12};
  const ChangeRaster raster =
      Measure(PaintedTown({tower}), Photographs(PaintedTown({}), {Overhead(-10, 0), Overhead(10, 0)}));
  const auto at = [&](double x, double y) {
    return raster.after.height_m[static_cast<size_t>((y + 20) / 0.5) * 80 + static_cast<size_t>((x + 20) / 0.5)];
  };
  for (double y = -4.8; y < 5; y += 0.5) EXPECT_TRUE(std::isnan(at(11.2, y))) << y << " " << at(11.2, y);
  EXPECT_NEAR(at(11.2, 7.2), 0, 0.3);
  EXPECT_TRUE(Areas(raster).empty());
}

TEST(MeasureChanges, ResultIsIndependentOfThreads) {
  const TriangleMesh before = PaintedTown({kHouse});
  const std::vector<ChangeView> views = Photographs(PaintedTown({kHouse, kNewHouse}), TownFlight());
  ChangeRaster one, many;
  {
    const ThreadLimit limit(1);
    one = Measure(before, views);
  }
  {
    const ThreadLimit limit(4);
    many = Measure(before, views);
  }
  EXPECT_TRUE(Same(one, many));
}

TEST(MeasureChanges, ResultIsIndependentOfTheDivisionIntoTiles) {
  // Shifted to the corner of four blocks.
  const Eigen::Vector3d shift(20, 24, 0);
  TriangleMesh before = PaintedTown({kHouse}), after = PaintedTown({kHouse, kNewHouse});
  for (Eigen::Vector3d& p : before.vertices) p += shift;
  for (Eigen::Vector3d& p : after.vertices) p += shift;
  std::vector<PosedCamera> cameras = TownFlight();
  cameras.push_back(Overhead(400, 0));  // sees nothing of it
  for (PosedCamera& camera : cameras) camera.translation_cam_from_world -= camera.rotation_cam_from_world * shift;
  const std::vector<ChangeView> views = Photographs(after, cameras);
  const CellRect cells{48, 56, 128, 136};
  const ChangeRaster whole = Measure(before, views, cells);
  EXPECT_EQ(Areas(whole).size(), 1u);
  const std::vector<int> needed = ViewsToMeasure(before, Ground(), cells, cameras, kTownGsd_m, LowSweep());
  EXPECT_LT(needed.size(), cameras.size());
  std::vector<ChangeView> some;
  for (const int v : needed) some.push_back(views[v]);
  const ChangeRaster parts[] = {Measure(before, some, {48, 56, 90, 136}), Measure(before, some, {90, 56, 128, 136})};
  EXPECT_TRUE(Same(whole, MergeRasters(parts)));
}

TEST(MeasureChanges, ImageWindowsGiveTheSameResult) {
  const TriangleMesh before = PaintedTown({});
  const std::vector<ChangeView> views = Photographs(PaintedTown({kNewHouse}), TownFlight());
  const auto crop = [](const FloatImage& image, int x0, int y0, int width, int height) {
    FloatImage part(width, height, image.channels);
    for (int c = 0; c < image.channels; ++c) {
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) part.at(x, y, c) = image.at(x0 + x, y0 + y, c);
      }
    }
    return part;
  };
  std::vector<ChangeView> windows = views;
  for (ChangeView& view : windows) {
    view.luminance = crop(view.luminance, 10, 20, 220, 150);
    view.likelihoods = crop(view.likelihoods, 10, 20, 220, 150);
    view.x0 = view.likelihood_at.first_x = 10;
    view.y0 = view.likelihood_at.first_y = 20;
  }
  const std::vector<ChangeArea> whole = Areas(Measure(before, views)), part = Areas(Measure(before, windows));
  ASSERT_EQ(whole.size(), 1u);
  ASSERT_EQ(part.size(), 1u);
  EXPECT_NEAR(part[0].area_m2, whole[0].area_m2, 8);
  EXPECT_LT((part[0].place - whole[0].place).norm(), 0.5);
  EXPECT_EQ(part[0].label_after, whole[0].label_after);
  EXPECT_NEAR(part[0].height_difference_m, whole[0].height_difference_m, 0.1);
}

}  // namespace
}  // namespace tessera
