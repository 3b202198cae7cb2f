// Frames of scenes in a map projection (Crs::Kind::kProjected).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "common/geodesy/frame.h"
#include "common/geodesy/reference_system.h"

namespace tessera {
namespace {

using testing::HasSubstr;

Crs Projected(int epsg, int vertical_epsg = 0, double height_m = 0) {
  Crs crs;
  crs.kind = Crs::Kind::kProjected;
  crs.epsg = epsg;
  crs.vertical_epsg = vertical_epsg;
  crs.height_m = height_m;
  return crs;
}

StatusOr<Eigen::Vector3d> GeodeticOfScene(const Crs& crs, const Eigen::Vector3d& p_scene) {
  const StatusOr<Frame> frame = Frame::Around(crs, p_scene);
  if (!frame.ok()) return frame.status();
  return frame->GeodeticFromLocal(frame->LocalFromScene(p_scene));
}

TEST(ProjectedFrameTest, IsATranslationAsForUtm) {
  const Eigen::Vector3d p(652000.125, 6863073.5, 130.25);
  const StatusOr<Frame> frame = Frame::Around(Projected(2154), p);
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(frame->rotation_local_from_scene(), Eigen::Matrix3d::Identity());
  for (int k = 0; k < 3; ++k) EXPECT_EQ(std::fmod(frame->origin_in_scene()[k], 1024), 0);
  EXPECT_LE((frame->origin_in_scene() - p).cwiseAbs().maxCoeff(), 512);
  EXPECT_EQ(frame->SceneFromLocal(frame->LocalFromScene(p)), p);
}

TEST(ProjectedFrameTest, UtmByItsCodeIsUtm) {
  Crs utm;
  utm.kind = Crs::Kind::kUtm;
  utm.zone = 32;
  const Eigen::Vector3d p(444140.54, 5784706.36, 34);
  const StatusOr<Eigen::Vector3d> by_code = GeodeticOfScene(Projected(32632), p), by_zone = GeodeticOfScene(utm, p);
  ASSERT_TRUE(by_code.ok() && by_zone.ok()) << by_code.status();
  EXPECT_LT((*by_code - *by_zone).head<2>().norm() * 6.4e6, 1e-6);
  EXPECT_EQ(by_code->z(), 34);
}

TEST(ProjectedFrameTest, HeightsAreConvertedByTheirDatum) {
  const Eigen::Vector3d p(500000, 5300000, 300);
  EXPECT_NEAR(GeodeticOfScene(Projected(32632, 5773), p)->z(), 347.57, 0.01);
  EXPECT_EQ(GeodeticOfScene(Projected(32632, 5773, 12), p)->z(), 312);                // as stated
  EXPECT_EQ(GeodeticOfScene(Projected(28992, 5709), {155000, 463000, 10})->z(), 10);  // no grid: kept
}

TEST(ProjectedFrameTest, ScenesAreInMetresWhereTheSystemIsInFeet) {
  const Eigen::Vector3d p(300000, 60000, 30);
  const StatusOr<Eigen::Vector3d> feet = GeodeticOfScene(Projected(2263), p);
  const StatusOr<Eigen::Vector3d> metres = GeodeticOfScene(Projected(32118), p);
  ASSERT_TRUE(feet.ok() && metres.ok()) << feet.status() << metres.status();
  EXPECT_LT((*feet - *metres).head<2>().norm() * 6.4e6, 1e-6);
  EXPECT_NEAR(feet->z(), 30, 1e-9);
}

TEST(ProjectedFrameTest, StoredFramesAreRestored) {
  const Eigen::Vector3d p(652000, 6863073, 130);
  const StatusOr<Frame> frame = Frame::Around(Projected(2154), p);
  ASSERT_TRUE(frame.ok());
  const Frame restored = Frame::Of(frame->crs(), frame->origin_in_scene(), frame->rotation_local_from_scene());
  const Eigen::Vector3d local = frame->LocalFromScene(p);
  EXPECT_EQ(*restored.GeodeticFromLocal(local), *frame->GeodeticFromLocal(local));
  // A frame that cannot be opened here still maps local coordinates.
  const Frame foreign = Frame::Of(Projected(999999), frame->origin_in_scene(), frame->rotation_local_from_scene());
  EXPECT_EQ(foreign.SceneFromLocal(local), p);
  EXPECT_THAT(std::string(foreign.GeodeticFromLocal(local).status().message()), HasSubstr("EPSG:999999"));
}

TEST(ProjectedFrameTest, RejectsInvalidCoordinatesAndCodes) {
  EXPECT_THAT(std::string(Frame::Around(Projected(999999), {1, 2, 3}).status().message()), HasSubstr("EPSG:999999"));
  EXPECT_THAT(std::string(Frame::Around(Projected(4326), {2, 48, 3}).status().message()),
              HasSubstr("expected the EPSG code of a projected system"));
  EXPECT_FALSE(Frame::Around(Projected(0), {1, 2, 3}).ok());
  EXPECT_FALSE(Frame::Around(Projected(2154), {652000, 5e8, 3}).ok());
  EXPECT_FALSE(Frame::Around(Projected(2154), {NAN, 0, 0}).ok());
  EXPECT_FALSE(Frame::Around(Projected(2154, 0, NAN), {652000, 6863073, 0}).ok());
  EXPECT_FALSE(Frame::Around(Projected(2154, 2154), {652000, 6863073, 0}).ok());
}

}  // namespace
}  // namespace tessera
