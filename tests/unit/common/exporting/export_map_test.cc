#include "common/exporting/export_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "common/geodesy/reference_system.h"

namespace tessera {
namespace {

ExportScene SceneIn(const Crs& crs, const Eigen::Vector3d& near) {
  ExportScene scene;
  scene.frame = *Frame::Around(crs, near);
  scene.gsd_m = 0.1;
  scene.ground.cell_m = 8;
  SceneClass roof;
  roof.name = "<img src=x>";
  scene.classes = {roof};
  return scene;
}

ExportScene UtmScene() {
  Crs crs;
  crs.kind = Crs::Kind::kUtm;
  crs.zone = 33;
  return SceneIn(crs, {391234, 5820123, 40});
}

TEST(ExportSceneTest, IsReadAsItWasWritten) {
  ExportScene scene = UtmScene();
  SceneSource source;
  source.crs = "EPSG:25833";
  source.offset = {391000.25, 5820000, 1.0 / 3};
  source.tiles = {"Tile_+000_+001"};
  source.tile_rects = {{0, 1.0 / 3, 100, 100}};
  source.heights.geoid_height_m = 44.7;
  scene.source = source;
  const StatusOr<ExportScene> read = ParseExportScene(ExportSceneToJson(scene));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(ExportSceneToJson(*read), ExportSceneToJson(scene));
  EXPECT_EQ(read->source, scene.source);
  EXPECT_EQ(read->frame.crs(), scene.frame.crs());
  EXPECT_EQ(read->frame.origin_in_scene(), scene.frame.origin_in_scene());
  EXPECT_EQ(read->classes[0].name, "<img src=x>");
}

TEST(ExportSceneTest, RefusesDamagedText) {
  EXPECT_FALSE(ParseExportScene("{").ok());
  EXPECT_FALSE(ParseExportScene("{}").ok());
  EXPECT_FALSE(ParseExportScene(std::string(100000, '[')).ok());
}

TEST(ExportMapTest, TakesLocalPointsToAnotherSystemAndBack) {
  const ExportScene scene = UtmScene();
  const StatusOr<ExportMap> map = ExportMap::Open(scene, "EPSG:32632");
  ASSERT_TRUE(map.ok()) << map.status();
  const Eigen::Vector3d local = scene.frame.LocalFromScene({391300, 5820200, 55});
  Eigen::Vector3d p = local;
  ASSERT_TRUE(map->FromLocal({&p, 1}).ok());
  EXPECT_GT(p.x(), 700000);  // east of zone 32
  EXPECT_NEAR(p.z(), 55, 1e-6);
  ASSERT_TRUE(map->ToLocal({&p, 1}).ok());
  EXPECT_LT((p - local).norm(), 1e-6);
}

TEST(ExportMapTest, RefusesASystemForASceneWithoutOne) {
  ExportScene scene;
  EXPECT_TRUE(ExportMap::Open(scene, "").ok());
  const Status status = ExportMap::Open(scene, "EPSG:32633").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("has no place on the globe"));
}

TEST(GlobeMapTest, PutsPointsWhereTheirLatitudeAndLongitudeAre) {
  const ExportScene scene = UtmScene();
  const StatusOr<GlobeMap> map = GlobeMap::Open(scene);
  ASSERT_TRUE(map.ok()) << map.status();
  ASSERT_TRUE(map->on_globe());
  const Eigen::Vector3d local = scene.frame.LocalFromScene({391300, 5820200, 55});
  const Eigen::Vector3d expected = GeocentricFromGeodetic(*scene.frame.GeodeticFromLocal(local));
  Eigen::Vector3d p = local;
  ASSERT_TRUE(map->EnuFromLocal({&p, 1}).ok());
  EXPECT_LT(p.norm(), 2000);
  EXPECT_NEAR(p.z(), 55, 1);
  EXPECT_LT((map->ecef_from_enu() * p - expected).norm(), 1e-6);
}

TEST(GlobeMapTest, TurnsUpToZWithoutASystem) {
  ExportScene scene;
  scene.up = Eigen::Vector3d::UnitY();
  scene.ground = MakeGroundPlane(scene.up, 8);
  const StatusOr<GlobeMap> map = GlobeMap::Open(scene);
  ASSERT_TRUE(map.ok());
  EXPECT_FALSE(map->on_globe());
  Eigen::Vector3d p = {1, 2, 3};
  ASSERT_TRUE(map->EnuFromLocal({&p, 1}).ok());
  EXPECT_DOUBLE_EQ(p.z(), 2);
  EXPECT_NEAR(p.norm(), std::sqrt(14.0), 1e-12);
}

}  // namespace
}  // namespace tessera
