#include "common/exporting/changes/changes_format.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "common/storage/files.h"

namespace tessera {
namespace {

using testing::HasSubstr;

// A triangle with its south-west corner at 9 degrees east, the central meridian of zone 32, and a hole.
constexpr char kChangesText[] = R"({"type": "FeatureCollection", "tessera_coordinates": "wgs84", "features": [
  {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [
    [[9.0, 48.0], [9.001, 48.0], [9.0, 48.001], [9.0, 48.0]], [[9.0001, 48.0001], [9.0002, 48.0001]], []]},
   "properties": {"id": 1, "kind": "built", "label_after": "<img src=x onerror=alert(1)>"}}]})";

class ChangesFormatTest : public testing::Test {
 protected:
  ChangesFormatTest() {
    Crs crs;
    crs.kind = Crs::Kind::kUtm;
    crs.zone = 32;
    scene_.frame = Frame::Around(crs, {500000, 5316000, 500}).value();
    Write(kChangesText);
  }
  void Write(const std::string& text) const { ASSERT_TRUE(WriteFileAtomic(Path(), text).ok()); }
  std::string Path() const { return folder_.path() + "/in.geojson"; }
  Status Join(const std::string& crs) {
    ExportOptions options;
    options.crs = crs;
    JoinInput input{scene_, options, {}, Path()};
    return JoinChanges(input, folder_.path(), {}).status();
  }
  nlohmann::ordered_json Joined(const std::string& crs) {
    const Status status = Join(crs);
    EXPECT_TRUE(status.ok()) << status;
    return nlohmann::ordered_json::parse(ReadFile(folder_.path() + "/changes.geojson").value());
  }

  const TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
  ExportScene scene_;
};

TEST_F(ChangesFormatTest, WithoutASystemTheFileIsCopied) {
  ASSERT_TRUE(Join("").ok());
  EXPECT_EQ(ReadFile(folder_.path() + "/changes.geojson").value(), kChangesText);
}

TEST_F(ChangesFormatTest, CoordinatesAreThoseOfTheSystem) {
  const auto json = Joined("EPSG:32632");
  EXPECT_EQ(json["crs"]["properties"]["name"], "urn:ogc:def:crs:EPSG::32632");
  EXPECT_EQ(json["tessera_coordinates"], "EPSG:32632");
  const auto& rings = json["features"][0]["geometry"]["coordinates"];
  EXPECT_NEAR(rings[0][0][0].get<double>(), 500000, 1e-3);
  EXPECT_NEAR(rings[0][0][1].get<double>(), 5316300, 500);
  EXPECT_NEAR(rings[0][1][0].get<double>() - 500000, 74.6, 0.1) << "0.001 degrees at 48 degrees north";
  EXPECT_NEAR(rings[0][2][1].get<double>() - rings[0][0][1].get<double>(), 111.1, 0.2);
  EXPECT_EQ(rings[0][3], rings[0][0]) << "rings stay closed";
  EXPECT_EQ(rings[1].size(), 2u);
  EXPECT_TRUE(rings[2].empty());
  EXPECT_EQ(json["features"][0]["properties"]["label_after"], "<img src=x onerror=alert(1)>");
}

TEST_F(ChangesFormatTest, DegreesKeepEightDecimals) {
  const auto json = Joined("EPSG:4258+7837");
  EXPECT_EQ(json["crs"]["properties"]["name"], "urn:ogc:def:crs:EPSG::4258");
  EXPECT_NEAR(json["features"][0]["geometry"]["coordinates"][1][0][0].get<double>(), 9.0001, 1e-6);
}

TEST_F(ChangesFormatTest, LocalCoordinatesAreThoseOfTheScene) {
  const auto json = Joined("local");
  EXPECT_FALSE(json.contains("crs"));
  EXPECT_NEAR(json["features"][0]["geometry"]["coordinates"][0][0][0].get<double>(), 500000, 1e-3);
}

TEST_F(ChangesFormatTest, MissingOrDamagedFilesAreErrors) {
  for (const char* text : {"", "{", "[]", "{}", R"({"type": 1, "tessera_coordinates": "wgs84", "features": [{}]})",
                           R"({"type": "FeatureCollection", "tessera_coordinates": "wgs84", "features":
                              [{"geometry": {"coordinates": [[["x", "y"]]]}}]})"}) {
    Write(text);
    EXPECT_EQ(Join("EPSG:32632").code(), absl::StatusCode::kInvalidArgument) << text;
  }
  Write(std::string(100000, '['));
  EXPECT_EQ(Join("EPSG:32632").code(), absl::StatusCode::kInvalidArgument);
  const ExportOptions options;
  const JoinInput input{scene_, options, {}, ""};
  EXPECT_THAT(std::string(JoinChanges(input, folder_.path(), {}).status().message()), HasSubstr("tessera update"));
}

}  // namespace
}  // namespace tessera
