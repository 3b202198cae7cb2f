#include "common/geodesy/frame.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "common/base/random.h"

namespace tessera {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

Crs Enu(double lat_deg, double lon_deg, double height_m) {
  Crs crs;
  crs.kind = Crs::Kind::kEnu;
  crs.lat_rad = lat_deg * kDegree;
  crs.lon_rad = lon_deg * kDegree;
  crs.height_m = height_m;
  return crs;
}
Crs Utm(int zone, bool north) {
  Crs crs;
  crs.kind = Crs::Kind::kUtm;
  crs.zone = zone;
  crs.north = north;
  return crs;
}
Crs Ecef() {
  Crs crs;
  crs.kind = Crs::Kind::kEcef;
  return crs;
}

Eigen::Vector3d GeodeticDeg(const Frame& frame, const Eigen::Vector3d& p_scene) {
  const StatusOr<Eigen::Vector3d> g = frame.GeodeticFromLocal(frame.LocalFromScene(p_scene));
  EXPECT_TRUE(g.ok()) << g.status();
  return g.ok() ? Eigen::Vector3d(g->x() / kDegree, g->y() / kDegree, g->z()) : Eigen::Vector3d::Zero();
}

// GeographicLib, example-Geocentric.cpp and example-LocalCartesian.cpp: near Mount Everest, and Calais seen from Paris.
TEST(FrameTest, PublishedGeocentricPoint) {
  const Eigen::Vector3d everest_ecef(302271.4, 5635928.4, 2979666.1);
  const StatusOr<Frame> frame = Frame::Around(Ecef(), everest_ecef);
  ASSERT_TRUE(frame.ok()) << frame.status();
  const Eigen::Vector3d g = GeodeticDeg(*frame, everest_ecef);
  EXPECT_NEAR(g.x(), 27.99, 2e-6);
  EXPECT_NEAR(g.y(), 86.93, 2e-6);
  EXPECT_NEAR(g.z(), 8820, 0.1);
}

TEST(FrameTest, PublishedLocalCartesianPoint) {
  // example-LocalCartesian.cpp: (x, y, z) = (-38e3, 230e3, -4e3) seen from Paris, that is Calais.
  const StatusOr<Frame> frame = Frame::Around(Enu(48 + 50 / 60.0, 2 + 20 / 60.0, 0), {-38e3, 230e3, -4e3});
  ASSERT_TRUE(frame.ok()) << frame.status();
  const Eigen::Vector3d g = GeodeticDeg(*frame, {-38e3, 230e3, -4e3});
  EXPECT_NEAR(g.x(), 50.9003, 1e-4);
  EXPECT_NEAR(g.y(), 1.79318, 1e-5);
  EXPECT_NEAR(g.z(), 264.915, 1e-3);
}

TEST(FrameTest, PublishedUtmPoint) {
  // GeoConvert's manual: 33.3 N 44.4 E is UTM 38n 444140.54 3684706.36.
  const StatusOr<Frame> frame = Frame::Around(Utm(38, true), {444140.54, 3684706.36, 34});
  ASSERT_TRUE(frame.ok()) << frame.status();
  const Eigen::Vector3d g = GeodeticDeg(*frame, {444140.54, 3684706.36, 34});
  EXPECT_NEAR(g.x(), 33.3, 1e-7);
  EXPECT_NEAR(g.y(), 44.4, 1e-7);
  EXPECT_EQ(g.z(), 34);
}

TEST(FrameTest, OriginsAreMultiplesOf1024AndZeroNearZero) {
  const StatusOr<Frame> near_zero = Frame::Around({}, {300, -511, 100});
  ASSERT_TRUE(near_zero.ok());
  EXPECT_EQ(near_zero->origin_in_scene(), Eigen::Vector3d::Zero());
  const StatusOr<Frame> far = Frame::Around(Utm(32, true), {444140.54, 5784706.36, 34});
  ASSERT_TRUE(far.ok());
  for (int k = 0; k < 3; ++k) EXPECT_EQ(std::fmod(far->origin_in_scene()[k], 1024), 0);
  EXPECT_LE((far->origin_in_scene() - Eigen::Vector3d(444140.54, 5784706.36, 34)).cwiseAbs().maxCoeff(), 512);
  EXPECT_EQ(far->rotation_local_from_scene(), Eigen::Matrix3d::Identity());
}

TEST(FrameTest, FarCoordinatesRoundTripExactly) {
  Random random(5);
  struct Case {
    Crs crs;
    Eigen::Vector3d city;
    double tolerance_m;
  };
  // UTM and ENU: one subtraction of a multiple of 1,024, undone exactly. ECEF rotates too.
  const Case cases[] = {{Utm(32, true), {444140, 4999000, 30}, 0},
                        {Enu(48, 2, 0), {3.5e6, -3.5e6, -2.1e6}, 0},
                        {{}, {5e6, 1e5, -30}, 0},
                        {Ecef(), {3923000, 300000, 5002000}, 5e-9}};
  for (const Case& c : cases) {
    const StatusOr<Frame> frame = Frame::Around(c.crs, c.city);
    ASSERT_TRUE(frame.ok()) << frame.status();
    for (int i = 0; i < 1000; ++i) {
      const Eigen::Vector3d offset(random.Uniform(-4e3, 4e3), random.Uniform(-4e3, 4e3), random.Uniform(-100, 300));
      const Eigen::Vector3d p = c.city + offset;
      const Eigen::Vector3d local = frame->LocalFromScene(p);
      EXPECT_LT(local.norm(), 8000);
      EXPECT_LE((frame->SceneFromLocal(local) - p).norm(), c.tolerance_m);
      // Distances are kept: the frame is rigid.
      EXPECT_NEAR((local - frame->LocalFromScene(c.city)).norm(), (p - c.city).norm(), 5e-9);
    }
  }
}

TEST(FrameTest, EcefLocalFrameIsEastNorthUp) {
  const Eigen::Vector3d city(3923000, 300000, 5002000);
  const StatusOr<Frame> frame = Frame::Around(Ecef(), city);
  ASSERT_TRUE(frame.ok());
  const Eigen::Vector3d at = frame->LocalFromScene(city);
  const Eigen::Vector3d here = *frame->GeodeticFromLocal(at);
  const Eigen::Vector3d up = *frame->GeodeticFromLocal(at + Eigen::Vector3d(0, 0, 10));
  const Eigen::Vector3d east = *frame->GeodeticFromLocal(at + Eigen::Vector3d(10, 0, 0));
  const Eigen::Vector3d north = *frame->GeodeticFromLocal(at + Eigen::Vector3d(0, 10, 0));
  EXPECT_NEAR(up.z() - here.z(), 10, 1e-5);
  EXPECT_GT(east.y(), here.y());
  EXPECT_NEAR(east.x(), here.x(), 1e-9);
  EXPECT_GT(north.x(), here.x());
  EXPECT_NEAR(north.z(), here.z(), 2e-3);
}

TEST(FrameTest, RejectsInvalidCoordinates) {
  EXPECT_FALSE(Frame::Around(Utm(0, true), {444140, 4999000, 0}).ok());
  EXPECT_FALSE(Frame::Around(Utm(61, true), {444140, 4999000, 0}).ok());
  EXPECT_FALSE(Frame::Around(Utm(32, true), {5e7, 4999000, 0}).ok());
  EXPECT_FALSE(Frame::Around(Enu(91, 0, 0), {0, 0, 0}).ok());
  EXPECT_FALSE(Frame::Around(Ecef(), {0, 0, 0}).ok());
  EXPECT_FALSE(Frame::Around({}, {NAN, 0, 0}).ok());
  const StatusOr<Frame> local = Frame::Around({}, {0, 0, 0});
  ASSERT_TRUE(local.ok());
  EXPECT_EQ(local->GeodeticFromLocal({0, 0, 0}).status().code(), absl::StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace tessera
