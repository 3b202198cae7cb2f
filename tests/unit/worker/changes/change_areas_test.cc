#include "worker/changes/change_areas.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/unit/worker/changes/painted_raster.h"

namespace tessera {
namespace {

constexpr double kAreaGsd_m = 0.15, kCell_m = 0.5;
const CellRect kAreaCells{-30, 40, 50, 120};

ChangeRaster Flat() { return FlatRaster(kAreaCells, kCell_m); }

std::vector<ChangeArea> Find(const ChangeRaster& raster, const ChangeAreaOptions& options = {},
                             std::span<const SurfaceRaster> refined = {}) {
  return FindChangeAreas({&raster, 1}, refined, kPaintedRoles, kAreaGsd_m, options);
}

TEST(ChangeAreas, UnchangedSurfaceHasNoAreas) { EXPECT_TRUE(Find(Flat()).empty()); }

TEST(ChangeAreas, NewHouseHasTheRightStatistics) {
  ChangeRaster raster = Flat();
  Paint(&raster, {0, 60, 20, 72}, 10, 0, 16, 2);
  const std::vector<ChangeArea> areas = Find(raster);
  ASSERT_EQ(areas.size(), 1u);
  const ChangeArea& area = areas[0];
  EXPECT_EQ(area.kind, ChangeKind::kBuilt);
  // The majority filter removes the four corner cells.
  EXPECT_NEAR(area.area_m2, 10 * 6, 1.01);
  EXPECT_NEAR(SignedArea(area.outline.outer), area.area_m2, 1.01);
  EXPECT_NEAR(area.place.x(), 5, 1e-9);
  EXPECT_NEAR(area.place.y(), 33, 1e-9);
  EXPECT_NEAR(area.place.z(), 16, 1e-6);
  EXPECT_NEAR(area.height_difference_m, 6, 1e-6);
  EXPECT_NEAR(area.volume_m3, 6 * area.area_m2, 1e-3);
  EXPECT_NEAR(area.agreement, 0.9, 1e-6);
  EXPECT_NEAR(area.agreement_before, 0.1, 1e-6);
  EXPECT_FALSE(area.followed.has_value());
  EXPECT_EQ(area.cells.size(), area.area_m2 / (kCell_m * kCell_m));
  for (const Eigen::Vector2i& cell : area.cells) EXPECT_TRUE((CellRect{0, 60, 20, 72}.Contains(cell)));
  EXPECT_EQ(area.low_m, 10);
  EXPECT_EQ(area.high_m, 16);
}

TEST(ChangeAreas, OutlinesEncloseTheCells) {
  ChangeRaster raster = Flat();
  Paint(&raster, {-10, 50, 40, 100}, 10, 0, 16, 2);
  Paint(&raster, {0, 60, 20, 80}, 10, 0, 10, 0);  // a courtyard
  Paint(&raster, {25, 85, 40, 100}, 10, 0, 10, 0);
  ChangeAreaOptions options;
  options.simplify_cells = 0;
  const std::vector<ChangeArea> areas = Find(raster, options);
  ASSERT_EQ(areas.size(), 1u);
  ASSERT_EQ(areas[0].outline.holes.size(), 1u);
  EXPECT_NEAR(SignedArea(areas[0].outline.outer) + SignedArea(areas[0].outline.holes[0]), areas[0].area_m2, 1e-9);
  const std::vector<ChangeArea> simple = Find(raster);
  EXPECT_NEAR(SignedArea(simple[0].outline.outer) + SignedArea(simple[0].outline.holes[0]), areas[0].area_m2,
              0.03 * areas[0].area_m2);
  EXPECT_LT(simple[0].outline.outer.size(), areas[0].outline.outer.size());
}

TEST(ChangeAreas, KindDependsOnHeightsAndClasses) {
  ChangeRaster raster = Flat();
  Paint(&raster, {-25, 45, -10, 60}, 10, 0, 15, 2);
  Paint(&raster, {0, 45, 15, 60}, 15, 1, 10, 0);
  Paint(&raster, {25, 45, 40, 60}, 10, 0, 14, 3);
  Paint(&raster, {-25, 75, -10, 90}, 14, 3, 10, 0);
  Paint(&raster, {0, 75, 15, 90}, 10, 0, 10, 3);
  const std::vector<ChangeArea> areas = Find(raster);
  ASSERT_EQ(areas.size(), 5u);
  EXPECT_EQ(areas[0].kind, ChangeKind::kBuilt);
  EXPECT_EQ(areas[1].kind, ChangeKind::kDemolished);
  EXPECT_LT(areas[1].volume_m3, 0);
  EXPECT_EQ(areas[2].kind, ChangeKind::kGrown);
  EXPECT_EQ(areas[3].kind, ChangeKind::kFelled);
  EXPECT_EQ(areas[4].kind, ChangeKind::kLabel);
  EXPECT_EQ(areas[4].label_before, 0);
  EXPECT_EQ(areas[4].label_after, 3);
}

TEST(ChangeAreas, NarrowAndSmallAreasAreDropped) {
  ChangeRaster raster = Flat();
  Paint(&raster, {-20, 45, 40, 49}, 10, 0, 16, 2);   // 60 m2, 2 m wide
  Paint(&raster, {-20, 60, -11, 69}, 10, 0, 16, 2);  // 20 m2
  EXPECT_TRUE(Find(raster).empty());
  // A narrow part next to a house does not extend it.
  Paint(&raster, {-20, 80, 0, 100}, 10, 0, 16, 2);
  Paint(&raster, {0, 80, 40, 83}, 10, 0, 16, 2);
  const std::vector<ChangeArea> areas = Find(raster);
  ASSERT_EQ(areas.size(), 1u);
  EXPECT_NEAR(areas[0].area_m2, 100, 2);
  ChangeAreaOptions options;
  options.min_area_m2 = 15;
  EXPECT_EQ(Find(raster, options).size(), 2u);
}

TEST(ChangeAreas, WeakDifferencesCountOnlyNextToStrongOnes) {
  ChangeRaster raster = Flat();
  Paint(&raster, {-20, 45, 0, 65}, 10, 0, 11.2f, 2);  // between the weak and the strong threshold
  EXPECT_TRUE(Find(raster).empty());
  Paint(&raster, {-8, 45, 0, 65}, 10, 0, 14, 2);
  const std::vector<ChangeArea> areas = Find(raster);
  ASSERT_EQ(areas.size(), 1u);
  EXPECT_NEAR(areas[0].area_m2, 100, 2);
}

TEST(ChangeAreas, AreasNeedAgreementOfTheNewImages) {
  ChangeRaster raster = Flat();
  Paint(&raster, {0, 60, 20, 72}, 10, 0, 16, 2);
  ChangeRaster doubtful = raster;
  for (float& score : doubtful.after_score) score = 0.3f;
  EXPECT_TRUE(Find(doubtful).empty());
  ChangeRaster both = raster;
  both.before_score = both.after_score;
  EXPECT_TRUE(Find(both).empty());
  ChangeRaster unknown = raster;
  for (float& h : unknown.after.height_m) h = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(Find(unknown).empty());
}

TEST(ChangeAreas, ClassesNeedAMarginAndRoofsMayShowFacades) {
  ChangeRaster raster = Flat();
  Paint(&raster, {0, 60, 20, 72}, 10, 0, 10, 3);
  EXPECT_EQ(Find(raster).size(), 1u);
  for (float& margin : raster.label_margin) margin *= 0.1f;
  EXPECT_TRUE(Find(raster).empty());
  ChangeRaster roof = Flat();
  Paint(&roof, {0, 60, 20, 72}, 10, 2, 10, 1);
  EXPECT_TRUE(Find(roof).empty());
}

TEST(ChangeAreas, ResultIsIndependentOfTheOrderOfTiles) {
  ChangeRaster whole = Flat();
  Paint(&whole, {0, 60, 20, 72}, 10, 0, 16, 2);
  Paint(&whole, {-20, 76, 30, 90}, 14, 2, 10, 0);
  // The same raster in four tiles whose borders cross both areas.
  std::vector<ChangeRaster> tiles;
  for (const CellRect& part :
       {CellRect{8, 66, 50, 120}, CellRect{-30, 40, 8, 66}, CellRect{8, 40, 50, 66}, CellRect{-30, 66, 8, 120}}) {
    ChangeRaster tile = FlatRaster(part, kCell_m);
    const auto clipped = [&](const CellRect& r) {
      return CellRect{std::max(r.x0, part.x0), std::max(r.y0, part.y0), std::min(r.x1, part.x1),
                      std::min(r.y1, part.y1)};
    };
    Paint(&tile, clipped({0, 60, 20, 72}), 10, 0, 16, 2);
    Paint(&tile, clipped({-20, 76, 30, 90}), 14, 2, 10, 0);
    tiles.push_back(std::move(tile));
  }
  const std::vector<ChangeArea> one = Find(whole), many = FindChangeAreas(tiles, {}, kPaintedRoles, kAreaGsd_m, {});
  ASSERT_EQ(one.size(), 2u);
  ASSERT_EQ(many.size(), 2u);
  for (size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].kind, many[i].kind);
    EXPECT_EQ(one[i].area_m2, many[i].area_m2);
    EXPECT_EQ(one[i].outline.outer, many[i].outline.outer);
    EXPECT_EQ(one[i].height_difference_m, many[i].height_difference_m);
  }
}

TEST(ChangeAreas, MarksAreasThatTheRefinedMeshFollows) {
  ChangeRaster raster = Flat();
  Paint(&raster, {-20, 60, 0, 72}, 10, 0, 16, 2);
  Paint(&raster, {20, 60, 40, 72}, 10, 0, 10, 3);
  const auto followed = [&](const SurfaceRaster& refined) {
    std::vector<bool> all;
    for (const ChangeArea& area : Find(raster, {}, {&refined, 1})) all.push_back(area.followed.value());
    return all;
  };
  EXPECT_THAT(followed(raster.before), testing::ElementsAre(false, false));
  EXPECT_THAT(followed(raster.after), testing::ElementsAre(true, true));
  // A city in which one tile was not refined again.
  SurfaceRaster half(CellRect{-30, 40, 10, 200}, kCell_m);
  for (int y = 40; y < 120; ++y) {
    for (int x = -30; x < 10; ++x) {
      const size_t i = static_cast<size_t>(y - 40) * 80 + (x + 30), j = static_cast<size_t>(y - 40) * 40 + (x + 30);
      half.height_m[j] = raster.after.height_m[i];
      half.label[j] = raster.after.label[i];
    }
  }
  EXPECT_THAT(followed(half), testing::ElementsAre(true, false));
}

TEST(ClassRoles, AreDerivedFromClassNames) {
  std::vector<SceneClass> classes(5);
  const char* const names[] = {"water", "vegetation", "facade", "ground", "roof"};
  for (size_t i = 0; i < classes.size(); ++i) classes[i].name = names[i];
  EXPECT_THAT(ClassRoles(classes), testing::ElementsAre(ClassRole::kOther, ClassRole::kVegetation, ClassRole::kBuilding,
                                                        ClassRole::kGround, ClassRole::kBuilding));
}

}  // namespace
}  // namespace tessera
