#include "common/geodesy/reference_system.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <thread>

namespace tessera {
namespace {

using testing::HasSubstr;
using RefKind = ReferenceSystem::Kind;

constexpr double kRefDegree = std::numbers::pi / 180;
constexpr double kMetresPerDegree = 111320;

ReferenceSystem SystemAt(const std::string& text, const Eigen::Vector3d& near, const HeightOptions& heights = {}) {
  StatusOr<ReferenceSystem> system = ReferenceSystem::Parse(text, heights);
  EXPECT_TRUE(system.ok()) << system.status();
  if (!system.ok()) return *ReferenceSystem::Parse("local");
  const Status located = system->Locate(near);
  EXPECT_TRUE(located.ok()) << located;
  return *std::move(system);
}

// Latitude and longitude in degrees, height.
Eigen::Vector3d GeodeticOf(const std::string& text, const Eigen::Vector3d& p, const HeightOptions& heights = {}) {
  Eigen::Vector3d g = p;
  const Status status = SystemAt(text, p, heights).ToGeodetic({&g, 1});
  EXPECT_TRUE(status.ok()) << status;
  return {g.x() / kRefDegree, g.y() / kRefDegree, g.z()};
}

Status LocateError(const std::string& text, const Eigen::Vector3d& near) {
  StatusOr<ReferenceSystem> system = ReferenceSystem::Parse(text);
  return system.ok() ? system->Locate(near) : system.status();
}

// All warnings, a line each.
std::string WarningsAt(const std::string& text, const Eigen::Vector3d& near, const HeightOptions& heights = {}) {
  const ReferenceSystem system = SystemAt(text, near, heights);
  std::string out;
  for (const std::string& warning : system.warnings()) out += warning + "\n";
  return out;
}

// Distance in plan, metres, between latitude and longitude in degrees.
double PlanDistance_m(const Eigen::Vector3d& a, double lat_deg, double lon_deg) {
  return kMetresPerDegree * std::hypot(a.x() - lat_deg, (a.y() - lon_deg) * std::cos(lat_deg * kRefDegree));
}

// `precision_m`: of the published numbers, and of the transformation to WGS 84 where the system has another datum.
struct PublishedPoint {
  const char *what, *crs;
  double easting, northing, lat_deg, lon_deg, precision_m;
};

constexpr double DegreesOf(double degrees, double minutes, double seconds) {
  return degrees + minutes / 60 + seconds / 3600;
}

TEST(ReferenceSystemTest, PublishedPointsOfMapProjections) {
  const PublishedPoint points[] = {
      // IOGP publication 373-7-2 (EPSG Guidance Note 7-2), the examples on WGS 84 and ETRS89.
      {"Lambert azimuthal equal area", "EPSG:3035", 3962799.45, 2999718.85, 50, 5, 0.01},
      {"polar stereographic, variant A", "EPSG:5041", 3320416.75, 632668.43, 73, 44, 0.01},
      {"manual of GeoConvert", "EPSG:32638", 444140.54, 3684706.36, 33.3, 44.4, 0.01},
      // Their false origins: parameters of the EPSG data set.
      {"Lambert 93", "EPSG:2154", 700000, 6600000, 46.5, 3, 0.001},
      {"Belgian Lambert 2008", "EPSG:3812", 649328, 665262, 50.797815, 4.359215833, 0.001},
      // Published in WGS 84 and ETRS89; PROJ's transformations without grids are worse than the numbers.
      {"swisstopo, Approximate formulas: the example", "EPSG:2056", 2700000, 1100000, DegreesOf(46, 2, 38.87),
       DegreesOf(8, 43, 49.79), 1.2},
      {"Ordnance Survey, OSTN15: Caister water tower in ETRS89", "EPSG:27700", 651409.804, 313177.450,
       DegreesOf(52, 39, 28.8282), DegreesOf(1, 42, 57.8663), 5},
      // The points of the test sheet of RDNAPTRANS2008, in ETRS89. Without its grid, PROJ states 0.25 to 1 m.
      {"RDNAPTRANS2008: Texel", "EPSG:28992", 117380.12, 575040.34, 53.160753042, 4.824761912, 0.4},
      {"RDNAPTRANS2008: Amersfoort", "EPSG:28992", 155000, 463000, 52.155172897, 5.387203657, 0.4},
      {"RDNAPTRANS2008: Zuid-Limburg", "EPSG:28992", 182260.45, 311480.67, 50.792584916, 5.773795548, 0.4}};
  for (const PublishedPoint& p : points) {
    const Eigen::Vector3d g = GeodeticOf(p.crs, {p.easting, p.northing, 12});
    EXPECT_LT(PlanDistance_m(g, p.lat_deg, p.lon_deg), p.precision_m) << p.what;
    EXPECT_NEAR(g.z(), 12, 1e-9) << p.what;
  }
}

// GeographicLib is an implementation of UTM of its own; Frame uses it for kUtm.
TEST(ReferenceSystemTest, UtmEqualsGeographicLib) {
  for (const auto& [zone, north] : {std::pair(32, true), {17, true}, {56, false}}) {
    Crs utm;
    utm.kind = Crs::Kind::kUtm;
    utm.zone = zone;
    utm.north = north;
    for (const Eigen::Vector3d& p : {Eigen::Vector3d(437036, 4572789, 3), {690123.5, 6250321.25, 120}}) {
      const StatusOr<Frame> frame = Frame::Around(utm, p);
      ASSERT_TRUE(frame.ok()) << frame.status();
      const StatusOr<Eigen::Vector3d> expected = frame->GeodeticFromLocal(frame->LocalFromScene(p));
      ASSERT_TRUE(expected.ok());
      const Eigen::Vector3d g = GeodeticOf("EPSG:" + std::to_string((north ? 32600 : 32700) + zone), p) * kRefDegree;
      EXPECT_LT((g - *expected).head<2>().norm() * 6.4e6, 1e-6);
      EXPECT_NEAR(g.z() / kRefDegree, p.z(), 1e-9);
    }
  }
}

// NGA's test points of EGM96 (outintpt.dat), computed from the harmonics; the grid of 15' interpolates.
TEST(ReferenceSystemTest, PublishedHeightsOfEgm96) {
  const double points[][3] = {{38.6281550, 269.7791550, -31.628}, {-14.6212170, 305.0211140, -2.969},
                              {46.8743190, 102.4487290, -43.575}, {-23.6174460, 133.8747120, 15.871},
                              {38.6254730, 359.9995000, 50.066},  {-0.4667440, 0.0023000, 17.329}};
  for (const auto& [lat_deg, lon_deg, height_m] : points) {
    EXPECT_NEAR(GeodeticOf("EPSG:4326+5773", {lon_deg, lat_deg, 0}).z(), height_m, 0.4) << lat_deg << " " << lon_deg;
  }
}

// A photograph's GPS height above EGM96, as ContextCapture states it in its block of Goodale Park.
TEST(ReferenceSystemTest, Egm96OfARealPhotograph) {
  const Eigen::Vector3d g = GeodeticOf("EPSG:4326+5773", {-83.0064163888889, 39.9752701666667, 157.918});
  EXPECT_NEAR(g.z() - 157.918, -34.40, 0.01);
  EXPECT_NEAR(g.x(), 39.9752701666667, 1e-12);
  EXPECT_NEAR(g.y(), -83.0064163888889, 1e-12);
  const Eigen::Vector3d mapped = GeodeticOf("EPSG:32617+5773", {328652, 4426793, 157.918});
  EXPECT_NEAR(mapped.z() - 157.918, -34.40, 0.01);
}

TEST(ReferenceSystemTest, EastNorthUp) {
  EXPECT_EQ(SystemAt(" enu: 48.833333333333336, 2.3333333333333335 ", {0, 0, 0}).kind(), RefKind::kEnu);
  EXPECT_NEAR(GeodeticOf("ENU:48.85,2.35,60", {0, 0, 5}).z(), 65, 1e-9);
  const StatusOr<ReferenceSystem> system = ReferenceSystem::Parse("ENU:48.85,2.35,60");
  ASSERT_TRUE(system.ok());
  EXPECT_EQ(system->kind(), RefKind::kEnu);
  EXPECT_EQ(system->GridCrs()->lat_rad, 48.85 * kRefDegree);
  for (const char* const wrong :
       {"ENU:", "ENU:1", "ENU:91,2", "ENU:1,2,3,4", "ENU:1;2", "ENU:nan,2", "ENU:1,2,", "ENU:1,2x"}) {
    EXPECT_THAT(std::string(ReferenceSystem::Parse(wrong).status().message()), HasSubstr("expected ENU:LAT,LON"))
        << wrong;
  }
}

// Coordinates of each system, with the point around which operations are chosen.
TEST(ReferenceSystemTest, RoundTripsAreExact) {
  const std::pair<const char*, Eigen::Vector3d> cases[] = {{"EPSG:2154", {652000.1, 6863073.6, 130}},
                                                           {"EPSG:2154+5720", {652000.1, 6863073.6, 130}},
                                                           {"EPSG:27700", {651409.804, 313177.45, 60}},
                                                           {"EPSG:28992+5709", {155123.25, 463999.5, 10}},
                                                           {"EPSG:32632+5773", {690123.5, 5350321.25, 520}},
                                                           {"EPSG:4326+5773", {-83.0064, 39.9752, 157.9}},
                                                           {"EPSG:2263+6360", {1000000, 200000, 300}},
                                                           {"EPSG:2193", {1600000, 5400000, 12}},
                                                           {"EPSG:2056", {2600000, 1200000, 540}},
                                                           {"EPSG:5514", {-744000, -1043000, 230}},
                                                           {"EPSG:26718", {500000, 4500000, 1}},
                                                           {"EPSG:4978", {4201000, 172460, 4780100}},
                                                           {"EPSG:4979", {2.35, 48.85, 130}},
                                                           {"ENU:48.85,2.35", {1200, -300, 40}}};
  for (const auto& [crs, near] : cases) {
    const ReferenceSystem system = SystemAt(crs, near);
    const double step =
        near.head<2>().cwiseAbs().maxCoeff() < 360 && system.kind() == RefKind::kGeographic ? 1e-2 : 900;
    std::vector<Eigen::Vector3d> points;
    for (int k = 0; k < 9; ++k) {
      points.push_back(near + Eigen::Vector3d((k % 3 - 1) * step, (k / 3 - 1) * step, 37.5 * (k % 4)));
    }
    std::vector<Eigen::Vector3d> back = points;
    ASSERT_TRUE(system.ToGeodetic(back).ok()) << crs;
    for (const Eigen::Vector3d& g : back) EXPECT_LT(std::abs(g.x()), 2) << crs;
    ASSERT_TRUE(system.FromGeodetic(back).ok()) << crs;
    const double metre = system.kind() == RefKind::kGeographic ? 1 / kMetresPerDegree : 1;
    for (size_t k = 0; k < points.size(); ++k) {
      EXPECT_LT((back[k] - points[k]).head<2>().cwiseAbs().maxCoeff(), 1e-7 * metre) << crs;
      EXPECT_NEAR(back[k].z(), points[k].z(), 1e-7) << crs;
    }
  }
}

TEST(ReferenceSystemTest, PoorAccuracyIsWarnedOfWithTheMissingGrid) {
  const ReferenceSystem british = SystemAt("EPSG:27700", {400000, 300000, 0});
  EXPECT_EQ(british.accuracy_m(), 2);
  EXPECT_THAT(WarningsAt("EPSG:27700", {400000, 300000, 0}),
              testing::AllOf(HasSubstr("an accuracy of 2 m"), HasSubstr("uk_os_OSTN15_NTv2_OSGBtoETRS.tif")));
  EXPECT_EQ(SystemAt("EPSG:2154", {652000, 6863000, 0}).accuracy_m(), 1);
  EXPECT_EQ(WarningsAt("EPSG:2154", {652000, 6863000, 0}), "");
  EXPECT_EQ(SystemAt("EPSG:32632", {500000, 5300000, 0}).accuracy_m(), 0);
  EXPECT_EQ(WarningsAt("EPSG:32632+5773", {500000, 5300000, 0}), "");
}

// An operation of the right region: PROJ lists that of Canada first.
TEST(ReferenceSystemTest, OperationsAreChosenByPlace) {
  EXPECT_EQ(SystemAt("EPSG:26718", {500000, 4500000, 0}).accuracy_m(), 10);
  EXPECT_EQ(SystemAt("EPSG:4267", {-100, 70, 0}).accuracy_m(), 8);
}

TEST(ReferenceSystemTest, HeightsThatCannotBeConvertedAreKept) {
  const Eigen::Vector3d p(155000, 463000, 10);
  EXPECT_EQ(GeodeticOf("EPSG:28992+5709", p).z(), 10);
  EXPECT_THAT(WarningsAt("EPSG:28992+5709", p),
              testing::AllOf(HasSubstr("NAP height"), HasSubstr("nl_nsgi_nlgeo2018.tif"), HasSubstr("up to 100 m")));
  EXPECT_EQ(GeodeticOf("EPSG:28992+5709", p, {.geoid_height_m = 43}).z(), 53);
  EXPECT_EQ(GeodeticOf("EPSG:28992+5709", p, {.ellipsoid = true}).z(), 10);
  EXPECT_EQ(WarningsAt("EPSG:28992+5709", p, {.geoid_height_m = 43}), "");
  EXPECT_EQ(WarningsAt("EPSG:28992+5709", p, {.ellipsoid = true}), "");
  EXPECT_EQ(GeodeticOf("EPSG:32632+5773", {500000, 5300000, 300}, {.ellipsoid = true}).z(), 300);
  EXPECT_EQ(GeodeticOf("EPSG:32632", {500000, 5300000, 300}, {.geoid_height_m = 47.5}).z(), 347.5);
}

TEST(ReferenceSystemTest, FeetBecomeMetres) {
  const double foot_m = 1200.0 / 3937;
  const ReferenceSystem system = SystemAt("EPSG:2263+6360", {1000000, 200000, 100});
  EXPECT_NEAR(system.units_m().x(), foot_m, 1e-12);
  EXPECT_NEAR(system.units_m().z(), foot_m, 1e-12);
  Eigen::Vector3d g(1000000, 200000, 100);
  ASSERT_TRUE(system.ToGeodetic({&g, 1}).ok());
  EXPECT_NEAR(g.z(), 100 * foot_m, 1e-9);
  EXPECT_THAT(system.warnings(), testing::Contains(HasSubstr("US survey foot (0.3048006096 m)")));
  // The same place in the system of the same projection in metres.
  const Eigen::Vector3d feet = GeodeticOf("EPSG:2263", {1000000, 200000, 100});
  const Eigen::Vector3d metres = GeodeticOf("EPSG:32118", {1000000 * foot_m, 200000 * foot_m, 100 * foot_m});
  EXPECT_LT((feet - metres).norm() * kMetresPerDegree, 1e-6);
}

TEST(ReferenceSystemTest, ReadsTheTextsOfOtherPrograms) {
  const std::string lambert =
      R"(PROJCS["RGF_1993_Lambert_93",GEOGCS["GCS_RGF_1993",DATUM["D_RGF_1993",SPHEROID["GRS_1980",6378137.0,)"
      R"(298.257222101]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION[)"
      R"("Lambert_Conformal_Conic"],PARAMETER["False_Easting",700000.0],PARAMETER["False_Northing",6600000.0],)"
      R"(PARAMETER["Central_Meridian",3.0],PARAMETER["Standard_Parallel_1",44.0],PARAMETER["Standard_Parallel_2",)"
      R"(49.0],PARAMETER["Latitude_Of_Origin",46.5],UNIT["Meter",1.0]])";
  const std::string utm =
      R"(PROJCS["WGS 84 / UTM zone 32N",GEOGCS["WGS 84",DATUM["World Geodetic System 1984",SPHEROID["WGS 84",6378137,)"
      R"(298.257223563],TOWGS84[0,0,0,0,0,0,0]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION[)"
      R"("Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",9],PARAMETER[)"
      R"("scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],UNIT["metre",1]])";
  const std::string egm96 =
      R"(VERT_CS["EGM96 geoid",VERT_DATUM["EGM96 geoid",2005],UNIT["metre",1],AXIS["Up",UP],AUTHORITY["EPSG","5773"]])";
  const Eigen::Vector3d at(500000, 5300000, 300);
  Crs zone_32;
  zone_32.kind = Crs::Kind::kUtm;
  zone_32.zone = 32;
  for (const std::string& text : {utm, std::string("+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs"),
                                  std::string("EPSG:32632"), std::string("epsg:32632\n")}) {
    const ReferenceSystem system = SystemAt(text, at);
    EXPECT_EQ(system.kind(), RefKind::kProjected);
    EXPECT_EQ(system.GridCrs(), zone_32) << text;
  }
  EXPECT_EQ(SystemAt(lambert, {652000, 6863000, 0}).GridCrs()->epsg, 2154);
  const ReferenceSystem compound = SystemAt("COMPD_CS[\"both\"," + utm + "," + egm96 + "]", at);
  EXPECT_EQ(compound.GridCrs()->epsg, 32632);
  EXPECT_EQ(compound.GridCrs()->vertical_epsg, 5773);
  EXPECT_NEAR(GeodeticOf("EPSG:32632+5773", at).z(), 347.57, 0.01);
  EXPECT_EQ(SystemAt("WGS84", {2, 48, 0}).kind(), RefKind::kGeographic);
  EXPECT_EQ(SystemAt("EPSG:4978", {4201000, 172460, 4780100}).kind(), RefKind::kGeocentric);
  for (const char* const local : {"", "local", "LOCAL", R"(LOCAL_CS["Local Coordinates",UNIT["metre",1]])"}) {
    const ReferenceSystem system = SystemAt(local, {1, 2, 3});
    EXPECT_EQ(system.kind(), RefKind::kLocal) << local;
    Eigen::Vector3d p(1, 2, 3);
    EXPECT_EQ(system.ToGeodetic({&p, 1}).code(), absl::StatusCode::kFailedPrecondition);
  }
}

TEST(ReferenceSystemTest, RefusesWhatProjWouldGuess) {
  // PROJ has only a ballpark operation for these.
  EXPECT_THAT(std::string(LocateError("EPSG:3375", {400000, 400000, 0}).message()),
              HasSubstr("no transformation to WGS 84"));
  EXPECT_THAT(std::string(LocateError("+proj=longlat +nadgrids=nope.gsb +ellps=bessel", {8, 50, 0}).message()),
              HasSubstr("expected nope.gsb"));
}

TEST(ReferenceSystemTest, WrongInputIsNamed) {
  for (const char* const wrong : {"EPSG:999999", "hello", "+proj=pipeline", "EPSG:5773", "EPSG:32632+5715", "PROJCS[",
                                  "EPSG:", "EPSG:4326+32632"}) {
    EXPECT_THAT(std::string(ReferenceSystem::Parse(wrong).status().message()), HasSubstr("crs: found '")) << wrong;
  }
  EXPECT_FALSE(ReferenceSystem::Parse(std::string(70000, 'x')).ok());
  EXPECT_FALSE(ReferenceSystem::Parse(std::string("EPSG:32632\0x", 12)).ok());
  EXPECT_THAT(std::string(LocateError("EPSG:2154", {500000, 5.3e7, 0}).message()), HasSubstr("outside the domain"));
  EXPECT_FALSE(LocateError("EPSG:32632", {1e300, 1, 1}).ok());
  EXPECT_FALSE(LocateError("EPSG:32632", {NAN, 1, 1}).ok());
  EXPECT_FALSE(LocateError("EPSG:4326", {2, 95, 1}).ok());
  EXPECT_THAT(WarningsAt("EPSG:2154", {500000, 5300000, 0}), HasSubstr("outside the area where the system is used"));
  const ReferenceSystem system = SystemAt("EPSG:32632", {500000, 5300000, 0});
  Eigen::Vector3d far(1e300, 0, 0);
  EXPECT_THAT(std::string(system.ToGeodetic({&far, 1}).message()), HasSubstr("1e+300"));
}

TEST(ReferenceSystemTest, ChoosesOperationsAroundAPlaceOnEarth) {
  StatusOr<ReferenceSystem> system = ReferenceSystem::Parse("EPSG:2154+5720");
  ASSERT_TRUE(system.ok());
  const Eigen::Vector3d geodetic(48.86 * kRefDegree, 2.35 * kRefDegree, 80);
  ASSERT_TRUE(system->LocateGeodetic(geodetic).ok());
  Eigen::Vector3d p = geodetic;
  ASSERT_TRUE(system->FromGeodetic({&p, 1}).ok());
  EXPECT_LT(PlanDistance_m(GeodeticOf("EPSG:2154", p), 48.86, 2.35), 1e-6);
}

// IOGP publication 373-7-2, geographic and geocentric, geocentric and topocentric conversions: the examples.
TEST(ReferenceSystemTest, PublishedGeocentricAndTopocentricPoints) {
  const Eigen::Vector3d geocentric(3771793.968, 140253.342, 5124304.349);
  const Eigen::Vector3d geodetic(DegreesOf(53, 48, 33.820) * kRefDegree, DegreesOf(2, 7, 46.380) * kRefDegree, 73.0);
  EXPECT_LT((GeocentricFromGeodetic(geodetic) - geocentric).norm(), 0.02);  // .001'' are 3 cm
  EXPECT_LT((GeodeticFromGeocentric(geocentric) - geodetic).head<2>().norm() * 6.4e6, 0.02);
  EXPECT_NEAR(GeodeticFromGeocentric(geocentric).z(), 73.0, 1e-3);
  const Eigen::Vector3d read = GeodeticOf("EPSG:4978", geocentric);
  EXPECT_LT(PlanDistance_m(read, DegreesOf(53, 48, 33.820), DegreesOf(2, 7, 46.380)), 0.02);
  EXPECT_NEAR(read.z(), 73.0, 1e-3);
  const Eigen::Vector3d seen = GeodeticOf("ENU:55,5,200", {-189013.869, -128642.040, -4220.171});
  EXPECT_LT(PlanDistance_m(seen, DegreesOf(53, 48, 33.820), DegreesOf(2, 7, 46.380)), 0.02);
  EXPECT_NEAR(seen.z(), 73.0, 1e-3);
}

TEST(ReferenceSystemTest, ThreadsShareASystem) {
  const ReferenceSystem system = SystemAt("EPSG:27700", {400000, 300000, 0});
  Eigen::Vector3d expected(400000, 300000, 5);
  ASSERT_TRUE(system.ToGeodetic({&expected, 1}).ok());
  std::vector<std::thread> threads;
  std::vector<int> wrong(4);
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (int k = 0; k < 500; ++k) {
        Eigen::Vector3d p(400000, 300000, 5);
        wrong[t] += !system.ToGeodetic({&p, 1}).ok() || p != expected;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, std::vector<int>(4));
}

}  // namespace
}  // namespace tessera
