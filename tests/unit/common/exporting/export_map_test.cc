#include "common/exporting/export_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "common/exporting/export_format.h"
#include "common/geodesy/reference_system.h"
#include "common/importing/frames.h"

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

// Earth-centred coordinates of a point of CH1903+ / LV95 (EPSG:2056) by the formulas of swisstopo ("Formulas and
// constants for the calculation of the Swiss conformal cylindrical projection", 2016, section 3.3), without PROJ.
Eigen::Vector3d SwissEarthCentred(const Eigen::Vector3d& p) {
  const double a = 6377397.155, e2 = 0.006674372230614, e = std::sqrt(e2), quarter = std::numbers::pi / 4;
  const double lat0 = (46 + 57.0 / 60 + 8.66 / 3600) * std::numbers::pi / 180;
  const double lon0 = (7 + 26.0 / 60 + 22.5 / 3600) * std::numbers::pi / 180;
  const double alpha = std::sqrt(1 + e2 / (1 - e2) * std::pow(std::cos(lat0), 4));
  const double b0 = std::asin(std::sin(lat0) / alpha);
  const double radius = a * std::sqrt(1 - e2) / (1 - e2 * std::pow(std::sin(lat0), 2));
  const double k = std::log(std::tan(quarter + b0 / 2)) - alpha * std::log(std::tan(quarter + lat0 / 2)) +
                   alpha * e / 2 * std::log((1 + e * std::sin(lat0)) / (1 - e * std::sin(lat0)));
  const double l_bar = (p.x() - 2600000) / radius;
  const double b_bar = 2 * (std::atan(std::exp((p.y() - 1200000) / radius)) - quarter);
  const double b = std::asin(std::cos(b0) * std::sin(b_bar) + std::sin(b0) * std::cos(b_bar) * std::cos(l_bar));
  const double l = std::atan2(std::sin(l_bar), std::cos(b0) * std::cos(l_bar) - std::sin(b0) * std::tan(b_bar));
  const double lon = lon0 + l / alpha;
  double lat = b;
  for (int i = 0; i < 20; ++i) {
    const double s = (std::log(std::tan(quarter + b / 2)) - k) / alpha +
                     e * std::log(std::tan(quarter + std::asin(e * std::sin(lat)) / 2));
    lat = 2 * std::atan(std::exp(s)) - 2 * quarter;
  }
  const double n = a / std::sqrt(1 - e2 * std::pow(std::sin(lat), 2));
  return {n * std::cos(lat) * std::cos(lon) + 674.374, n * std::cos(lat) * std::sin(lon) + 15.056,
          n * (1 - e2) * std::sin(lat) + 405.346};
}

TEST(GlobeMapTest, PutsPointsOfAProjectedSourceWithinACentimetre) {
  HeightOptions ellipsoid;
  ellipsoid.ellipsoid = true;
  const Eigen::Vector3d offset(2683000, 1247500, 0), centre(60, -40, 8);  // Zurich
  for (const FrameChoice choice : {FrameChoice::kGrid, FrameChoice::kTrue}) {
    const StatusOr<SceneMap> source = SceneMap::Choose({"EPSG:2056", offset}, choice, ellipsoid, centre);
    ASSERT_TRUE(source.ok()) << source.status();
    Eigen::Vector3d near = centre;
    ASSERT_TRUE(source->SceneFromSource({&near, 1}).ok());
    const ExportScene scene = SceneIn(source->scene(), near);
    const StatusOr<GlobeMap> map = GlobeMap::Open(scene);
    ASSERT_TRUE(map.ok()) << map.status();
    for (const Eigen::Vector3d& of_source : {centre, Eigen::Vector3d(-900, 1200, 0), Eigen::Vector3d(2000, 5, -3)}) {
      Eigen::Vector3d p = of_source;
      ASSERT_TRUE(source->SceneFromSource({&p, 1}).ok());
      p = scene.frame.LocalFromScene(p);
      ASSERT_TRUE(map->EnuFromLocal({&p, 1}).ok());
      p = map->ecef_from_enu() * p;
      // The source's heights are above the ellipsoid of WGS 84.
      const Eigen::Vector3d foot = GeodeticFromGeocentric(SwissEarthCentred(of_source + offset));
      const Eigen::Vector3d expected = GeocentricFromGeodetic({foot.x(), foot.y(), of_source.z()});
      EXPECT_LT((p - expected).norm(), 0.01) << (p - expected).transpose();
    }
  }
}

// Earth-centred coordinates on an ellipsoid by the textbook's formula.
Eigen::Vector3d EarthCentredOn(double a, double e2, double lat_rad, double lon_rad) {
  const double n = a / std::sqrt(1 - e2 * std::pow(std::sin(lat_rad), 2));
  return {n * std::cos(lat_rad) * std::cos(lon_rad), n * std::cos(lat_rad) * std::sin(lon_rad),
          n * (1 - e2) * std::sin(lat_rad)};
}

// A point with published coordinates in the projection and in its datum's latitude and longitude, and the published
// transformation of the datum to WGS 84: metres, seconds of arc about the point's axes (position vector), millionths.
struct DatumPoint {
  const char* what;
  int epsg;
  double easting, northing, lat_deg, lon_deg, a, inverse_f;
  Eigen::Vector3d shift_m, turn_arcsec;
  double scale_ppm;
};

TEST(GlobeMapTest, PutsPublishedPointsOfOtherDatumsWithinACentimetre) {
  const double second = std::numbers::pi / 180 / 3600;
  const DatumPoint points[] = {
      // Ordnance Survey, A guide to coordinate systems in Great Britain, annexe C: the worked example on Airy 1830; its
      // section 6.6: the parameters, as EPSG:1314 rounds them.
      {"British National Grid",
       27700,
       651409.903,
       313177.270,
       52 + 39.0 / 60 + 27.2531 / 3600,
       1 + 43.0 / 60 + 4.5177 / 3600,
       6377563.396,
       299.3249646,
       {446.448, -125.157, 542.06},
       {0.15, 0.247, 0.842},
       -20.489},
      // Formulas of swisstopo: the projection's origin is the old observatory in Bern; a translation.
      {"LV95",
       2056,
       2600000,
       1200000,
       46 + 57.0 / 60 + 8.66 / 3600,
       7 + 26.0 / 60 + 22.5 / 3600,
       6377397.155,
       299.1528128,
       {674.374, 15.056, 405.346},
       {0, 0, 0},
       0}};
  for (const DatumPoint& point : points) {
    const double f = 1 / point.inverse_f;
    const Eigen::Vector3d p =
        EarthCentredOn(point.a, f * (2 - f), point.lat_deg * 3600 * second, point.lon_deg * 3600 * second);
    const Eigen::Vector3d turned = p + (second * point.turn_arcsec).cross(p);
    const Eigen::Vector3d foot = GeodeticFromGeocentric(point.shift_m + (1 + 1e-6 * point.scale_ppm) * turned);
    Crs crs;
    crs.kind = Crs::Kind::kProjected;
    crs.epsg = point.epsg;
    const Eigen::Vector3d in_scene(point.easting, point.northing, 30);
    const ExportScene scene = SceneIn(crs, in_scene + Eigen::Vector3d(400, -300, 0));
    const StatusOr<GlobeMap> map = GlobeMap::Open(scene);
    ASSERT_TRUE(map.ok()) << point.what << ": " << map.status();
    Eigen::Vector3d found = scene.frame.LocalFromScene(in_scene);
    ASSERT_TRUE(map->EnuFromLocal({&found, 1}).ok());
    found = map->ecef_from_enu() * found;
    const Eigen::Vector3d expected = GeocentricFromGeodetic({foot.x(), foot.y(), 30});
    EXPECT_LT((found - expected).norm(), 0.01) << point.what << ": " << (found - expected).transpose();
  }
}

TEST(GlobeMapTest, WarnsOfAPlaceThatMissesAGrid) {
  const auto warnings = [](int epsg, const Eigen::Vector3d& near) {
    Crs crs;
    crs.kind = Crs::Kind::kProjected;
    crs.epsg = epsg;
    ExportOptions options;
    options.formats = {"3dtiles"};
    std::string all;
    for (const std::string& warning : ExportWarnings(options, SceneIn(crs, near))) all += warning + "\n";
    return all;
  };
  EXPECT_THAT(warnings(27700, {400000, 300000, 0}),
              testing::AllOf(testing::HasSubstr("3dtiles: "), testing::HasSubstr("OSTN15")));
  EXPECT_EQ(warnings(2154, {652000, 6863000, 0}), "");
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
