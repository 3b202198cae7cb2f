#include "worker/changes/change_report.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "common/imaging/image_io.h"
#include "common/storage/files.h"
#include "tests/unit/worker/changes/painted_raster.h"

namespace tessera {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

class ChangeReportTest : public testing::Test {
 protected:
  void SetUp() override {
    scene_.name = "town";
    for (const char* name : {"ground", "facade", "roof", "vegetation"}) scene_.classes.emplace_back().name = name;
    raster_ = FlatRaster({0, 0, 60, 40}, 0.5);
    Paint(&raster_, {10, 10, 30, 30}, 10, 0, 16, 2);
    Paint(&raster_, {40, 10, 55, 30}, 14, 3, 10, 0);
    raster_.after.height_m[0] = std::nanf("");
    areas_ = FindChangeAreas({&raster_, 1}, {}, kPaintedRoles, 0.15, {});
    ASSERT_EQ(areas_.size(), 2u);
  }
  void Place(const Crs& crs, const Eigen::Vector3d& point) {
    const StatusOr<Frame> frame = Frame::Around(crs, point);
    ASSERT_TRUE(frame.ok()) << frame.status();
    scene_.frame = *frame;
  }
  ChangeReport Report() const { return {scene_, ground_, raster_, areas_, 0.15, {0.75, 0.5, {0.125, 0.25}, {}}}; }

  SceneDescription scene_;
  GroundPlane ground_ = MakeGroundPlane(Eigen::Vector3d::UnitZ(), 0.5);
  ChangeRaster raster_;
  std::vector<ChangeArea> areas_;
};

TEST_F(ChangeReportTest, JsonHasAllFields) {
  Place({}, {5000, 3000, 0});
  areas_[1].followed = false;
  areas_[1].outdated_faces = 7;
  const auto json = nlohmann::json::parse(ChangesJson(Report()));
  EXPECT_EQ(json["tessera_changes"], 1);
  EXPECT_EQ(json["scene"], "town");
  EXPECT_EQ(json["cell_m"], 0.5);
  EXPECT_NEAR(json["measured_area_m2"], (60 * 40 - 1) * 0.25, 0.06);
  EXPECT_EQ(json["totals"]["built"]["count"], 1);
  EXPECT_EQ(json["totals"]["felled"]["count"], 1);
  EXPECT_EQ(json["totals"]["label"]["count"], 0);
  EXPECT_EQ(json["needs_mesh"], 1);
  EXPECT_EQ(json["disagreement"]["heights"], 0.125);
  EXPECT_EQ(json["disagreement"]["labels"], 0.25);
  EXPECT_EQ(json["disagreement"]["agreement_before"], 0.5);
  EXPECT_TRUE(json["disagreement"]["refined"].is_null());
  ASSERT_EQ(json["areas"].size(), 2u);
  const auto& area = json["areas"][0];
  EXPECT_EQ(area["id"], 1);
  EXPECT_EQ(area["kind"], "built");
  EXPECT_NEAR(area["area_m2"], areas_[0].area_m2, 0.01);
  EXPECT_EQ(area["height_difference_m"], 6.0);
  EXPECT_EQ(area["label_before"], "ground");
  EXPECT_EQ(area["label_after"], "roof");
  EXPECT_TRUE(area["followed"].is_null());
  EXPECT_FALSE(area.contains("new_mesh"));
  const auto& unfollowed = json["areas"][1];
  EXPECT_EQ(unfollowed["followed"], false);
  EXPECT_EQ(unfollowed["new_mesh"]["outdated_faces"], 7);
  const Eigen::Vector3d low = scene_.frame.SceneFromLocal({20, 5, 10}),
                        high = scene_.frame.SceneFromLocal({27.5, 15, 14});
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(unfollowed["new_mesh"]["box"][0][k], low[k], 0.01);
    EXPECT_NEAR(unfollowed["new_mesh"]["box"][1][k], high[k], 0.01);
  }
  EXPECT_FALSE(area.contains("lon_lat"));
  // In the scene's own coordinates, not the local frame.
  const Eigen::Vector3d place = scene_.frame.SceneFromLocal({10, 10, 16});
  EXPECT_GT(place.norm(), 1000);
  EXPECT_NEAR(area["place"][0], place.x(), 0.01);
  EXPECT_NEAR(area["place"][1], place.y(), 0.01);
  EXPECT_EQ(area["rings"][0].size(), areas_[0].outline.outer.size());
}

TEST_F(ChangeReportTest, GeoJsonOfALocalSceneIsInSceneCoordinates) {
  Place({}, {5000, 3000, 0});
  const auto json = nlohmann::json::parse(ChangesGeoJson(Report()));
  EXPECT_EQ(json["type"], "FeatureCollection");
  EXPECT_EQ(json["tessera_coordinates"], "scene");
  ASSERT_EQ(json["features"].size(), 2u);
  const auto& ring = json["features"][0]["geometry"]["coordinates"][0];
  EXPECT_EQ(json["features"][0]["geometry"]["type"], "Polygon");
  EXPECT_EQ(ring.front(), ring.back());
  EXPECT_EQ(ring.size(), areas_[0].outline.outer.size() + 1);
  const Eigen::Vector2d& p = areas_[0].outline.outer[0];
  const Eigen::Vector3d q = scene_.frame.SceneFromLocal({p.x(), p.y(), 16});
  EXPECT_NEAR(ring[0][0], q.x(), 1e-3);
  EXPECT_NEAR(ring[0][1], q.y(), 1e-3);
  EXPECT_EQ(json["features"][1]["properties"]["kind"], "felled");
  EXPECT_EQ(json["features"][1]["properties"]["height_difference_m"], -4.0);
}

TEST_F(ChangeReportTest, GeoJsonOfAGeoreferencedSceneIsInLongitudeAndLatitude) {
  Crs crs;
  crs.kind = Crs::Kind::kEnu;
  crs.lat_rad = 47.4 * kDegree;
  crs.lon_rad = 8.5 * kDegree;
  Place(crs, {0, 0, 0});
  const auto json = nlohmann::json::parse(ChangesGeoJson(Report()));
  EXPECT_EQ(json["tessera_coordinates"], "wgs84");
  // 111 km per degree near the origin.
  const auto& p = json["features"][0]["geometry"]["coordinates"][0][0];
  const Eigen::Vector2d local = areas_[0].outline.outer[0];
  EXPECT_NEAR(p[0], 8.5 + local.x() / (111320 * std::cos(47.4 * kDegree)), 1e-6);
  EXPECT_NEAR(p[1], 47.4 + local.y() / 111180, 1e-6);
  const auto report = nlohmann::json::parse(ChangesJson(Report()));
  EXPECT_NEAR(report["areas"][0]["lon_lat"][0], 8.5 + 10 / (111320 * std::cos(47.4 * kDegree)), 1e-6);
}

TEST_F(ChangeReportTest, ImageShowsEachAreaInTheColourOfItsKind) {
  const ByteImage image = DrawChanges(Report(), 600);
  EXPECT_EQ(image.width, 600);
  EXPECT_EQ(image.height, 400);
  // North is up. Check the middle of the house, 20 cells from either corner, and the felled tree.
  const auto reddest = [&](int x, int y) { return image.at(x, y, 0) > image.at(x, y, 2) + 60; };
  EXPECT_TRUE(reddest(200, 200));
  EXPECT_GT(image.at(200, 200, 0), image.at(200, 200, 1) + 60);
  EXPECT_TRUE(reddest(475, 200));
  EXPECT_FALSE(reddest(350, 200));
  EXPECT_EQ(image.at(350, 200, 0), image.at(350, 200, 2));
}

TEST_F(ChangeReportTest, WritesThreeFiles) {
  const StatusOr<TempFolder> folder = TempFolder::Create("");
  ASSERT_TRUE(folder.ok());
  const std::string out = folder->path() + "/report";
  const Status status = WriteChangeReport(Report(), out);
  ASSERT_TRUE(status.ok()) << status;
  for (const char* name : {"/changes.json", "/changes.geojson", "/changes.png"}) EXPECT_TRUE(FileExists(out + name));
  EXPECT_EQ(*ReadFile(out + "/changes.json"), ChangesJson(Report()));
  EXPECT_EQ(ReadRgb(out + "/changes.png")->width, DrawChanges(Report()).width);
}

}  // namespace
}  // namespace tessera
