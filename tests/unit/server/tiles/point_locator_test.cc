#include "server/tiles/point_locator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace tessera {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

Survey SurveyIn(const Crs& crs, const Eigen::Vector3d& near, const Eigen::Vector3d& up) {
  const StatusOr<Frame> frame = Frame::Around(crs, near);
  EXPECT_TRUE(frame.ok()) << frame.status();
  Survey survey;
  survey.up = up;
  survey.ground = MakeGroundPlane(up, 8);
  survey.classes.resize(1);
  survey.crs = crs;
  survey.origin_in_scene = frame->origin_in_scene();
  survey.rotation_local_from_scene = frame->rotation_local_from_scene();
  return survey;
}

Crs Utm32() {
  Crs crs;
  crs.kind = Crs::Kind::kUtm;
  crs.zone = 32;
  return crs;
}

Crs Lambert93() {
  Crs crs;
  crs.kind = Crs::Kind::kProjected;
  crs.epsg = 2154;
  return crs;
}

// Values of GeographicLib's GeoConvert.
TEST(PointLocatorTest, GivesCoordinatesInUtmAndOnTheGlobe) {
  const Survey survey = SurveyIn(Utm32(), {693300, 5330900, 0}, {0, 0, 1});
  const auto locator = PointLocator::Open(survey);
  ASSERT_TRUE(locator.ok()) << locator.status();
  const Eigen::Vector3d in_scene(693566.08829, 5330684.896675, 500);
  const auto in_tiles = locator->TilesFromLocal(in_scene - survey.origin_in_scene);
  ASSERT_TRUE(in_tiles.ok());
  EXPECT_LT((*in_tiles - (in_scene - survey.origin_in_scene)).norm(), 20);  // a few metres a kilometre of convergence
  const auto found = locator->Locate(*in_tiles);
  ASSERT_TRUE(found.ok()) << found.status();
  EXPECT_EQ(found->crs, "WGS 84 / UTM zone 32N (EPSG:32632)");
  EXPECT_LT((found->p - in_scene).norm(), 1e-4);
  EXPECT_NEAR(found->geodetic->x() / kDegree, 48.1, 1e-9);
  EXPECT_NEAR(found->geodetic->y() / kDegree, 11.6, 1e-9);
  EXPECT_NEAR(found->geodetic->z(), 500, 1e-4);
  EXPECT_LT((locator->OnGround(*found) - (in_scene - survey.origin_in_scene).head<2>()).norm(), 1e-4);
}

// A system that no formula for UTM fits: Paris in Lambert-93.
TEST(PointLocatorTest, GivesCoordinatesInOtherProjections) {
  const auto locator = PointLocator::Open(SurveyIn(Lambert93(), {652000, 6862000, 35}, {0, 0, 1}));
  ASSERT_TRUE(locator.ok()) << locator.status();
  const auto origin = locator->Locate({0, 0, 0}), north = locator->Locate({0, 1000, 0});
  ASSERT_TRUE(origin.ok() && north.ok());
  EXPECT_EQ(origin->crs, "RGF93 v1 / Lambert-93 (EPSG:2154)");
  EXPECT_NEAR(origin->geodetic->x() / kDegree, 48.857, 0.01);
  EXPECT_NEAR(origin->geodetic->y() / kDegree, 2.346, 0.01);
  // The meridian is inclined to the grid: sin(46.5 degrees) (3 - 2.35) degrees.
  const Eigen::Vector3d step = north->p - origin->p;
  EXPECT_NEAR(std::atan2(step.x(), step.y()) / kDegree, 0.7256 * (3 - origin->geodetic->y() / kDegree), 0.01);
}

TEST(PointLocatorTest, AgreesWithTheExportInEverySystem) {
  Crs enu;
  enu.kind = Crs::Kind::kEnu;
  enu.lat_rad = 48 * kDegree;
  enu.lon_rad = 11 * kDegree;
  enu.height_m = 500;
  Crs ecef;
  ecef.kind = Crs::Kind::kEcef;
  const struct {
    Crs crs;
    Eigen::Vector3d near, up = {0, 0, 1};
  } kScenes[] = {{Crs(), {10, 20, 30}, {0, 0.6, 0.8}},
                 {enu, {3000, -2000, 10}},
                 {ecef, {4180613.7, 858156.8, 4724681.4}},
                 {Utm32(), {693300, 5330900, 500}},
                 {Lambert93(), {652000, 6862000, 35}}};
  for (const auto& [crs, near, up] : kScenes) {
    const Survey survey = SurveyIn(crs, near, up);
    const auto locator = PointLocator::Open(survey);
    ASSERT_TRUE(locator.ok()) << locator.status();
    const auto scene = ExportSceneOf(survey);
    const auto map = ExportMap::Open(*scene, "");
    for (const Eigen::Vector3d& local : {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(812.5, -440.25, 61)}) {
      const auto in_tiles = locator->TilesFromLocal(local);
      ASSERT_TRUE(in_tiles.ok());
      const auto found = locator->Locate(*in_tiles);
      ASSERT_TRUE(found.ok()) << found.status();
      EXPECT_LT((found->in_local - local).norm(), 1e-5) << found->crs;
      EXPECT_LT((found->in_scene - scene->frame.SceneFromLocal(local)).norm(), 1e-5) << found->crs;
      Eigen::Vector3d exported = local;
      ASSERT_TRUE(map->FromLocal({&exported, 1}).ok());
      EXPECT_LT((found->p - exported).norm(), 1e-5) << found->crs;
      EXPECT_EQ(found->geodetic.has_value(), crs.kind != Crs::Kind::kLocal);
      EXPECT_EQ(found->crs.empty(), crs.kind == Crs::Kind::kLocal);
      EXPECT_LT((locator->OnGround(*found) - survey.ground.Coordinates(local)).norm(), 1e-5);
    }
    EXPECT_EQ(locator->Locate({0, std::nan(""), 0}).status().code(), absl::StatusCode::kInvalidArgument);
  }
}

}  // namespace
}  // namespace tessera
