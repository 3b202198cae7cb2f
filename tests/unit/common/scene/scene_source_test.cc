// `crs` of type projected, and `source`, in scene.json.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "absl/strings/str_cat.h"
#include "common/scene/scene_json.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

SceneFile SceneWith(const std::string& keys) {
  Faults faults;
  SceneFile file = ParseSceneFile(absl::StrCat("{\"tessera_scene\": 1, ", keys, "}"), "scene.json", &faults);
  EXPECT_THAT(faults.messages(), IsEmpty());
  return file;
}
std::vector<std::string> FaultsWith(const std::string& keys) {
  Faults faults;
  ParseSceneFile(absl::StrCat("{\"tessera_scene\": 1, ", keys, "}"), "scene.json", &faults);
  return faults.messages();
}

TEST(SceneSourceTest, ProjectedCoordinates) {
  const Crs crs =
      SceneWith(R"("crs": {"type": "projected", "epsg": 2154, "vertical": 5720, "geoid_height_m": 44.5})").crs;
  EXPECT_EQ(crs.kind, Crs::Kind::kProjected);
  EXPECT_EQ(crs.epsg, 2154);
  EXPECT_EQ(crs.vertical_epsg, 5720);
  EXPECT_EQ(crs.height_m, 44.5);
  const Crs plain = SceneWith(R"("crs": {"type": "projected", "epsg": 2154})").crs;
  EXPECT_EQ(plain.epsg, 2154);
  EXPECT_EQ(plain.vertical_epsg, 0);
  EXPECT_EQ(plain.height_m, 0);
}

TEST(SceneSourceTest, WrongProjectedCoordinatesAreNamed) {
  EXPECT_THAT(FaultsWith(R"("crs": {"type": "projected"})"), ElementsAre(HasSubstr("no epsg")));
  EXPECT_THAT(FaultsWith(R"("crs": {"type": "projected", "epsg": 2154.5})"), ElementsAre(HasSubstr("crs.epsg")));
  EXPECT_THAT(FaultsWith(R"("crs": {"type": "projected", "epsg": "2154"})"), ElementsAre(HasSubstr("crs.epsg")));
  EXPECT_THAT(FaultsWith(R"("crs": {"type": "projected", "epsg": 2154, "vertical": -1, "zone": 3})"),
              ElementsAre(HasSubstr("crs.vertical: found -1"), HasSubstr("unknown key 'zone'")));
  EXPECT_THAT(FaultsWith(R"("crs": {"type": "utm", "zone": 32, "epsg": 2154})"),
              ElementsAre(HasSubstr("unknown key 'epsg'")));
}

TEST(SceneSourceTest, CrsIsReadAsItWasWritten) {
  std::vector<Crs> all(6);
  all[1].kind = Crs::Kind::kUtm;
  all[1].zone = 56;
  all[1].north = false;
  all[2].kind = Crs::Kind::kEcef;
  all[3].kind = Crs::Kind::kProjected;
  all[3].epsg = 28992;
  all[3].vertical_epsg = 5709;
  all[4] = all[3];
  all[4].vertical_epsg = 0;
  all[4].height_m = 43.25;
  all[5].kind = Crs::Kind::kEnu;
  all[5].height_m = 0.1;
  for (int k = 0; k < 200; ++k) {
    Crs enu = all[5];
    enu.lat_rad = (-89 + 0.873213 * k) * (std::numbers::pi / 180);
    enu.lon_rad = (-179 + 1.773217 * k) * (std::numbers::pi / 180);
    all.push_back(enu);
  }
  for (const Crs& crs : all) {
    EXPECT_EQ(SceneWith("\"crs\": " + CrsToJson(crs)).crs, crs) << CrsToJson(crs);
  }
  Crs paris = all[5];
  paris.lat_rad = 48.865903 * (std::numbers::pi / 180);
  EXPECT_THAT(CrsToJson(paris), HasSubstr("\"lat_deg\":48.865903,"));
}

TEST(SceneSourceTest, SourceIsReadAsItWasWritten) {
  EXPECT_FALSE(SceneWith("\"name\": \"a\"").source.has_value());
  SceneSource source;
  source.crs = "PROJCS[\"a \\ b\"]";
  source.offset = {1.0 / 3, -5e6, 0.1};
  source.tiles = {"Tile_+001_-002", "a\xc3\xa9"};
  EXPECT_EQ(SceneWith("\"source\": " + SceneSourceToJson(source)).source, source);
  source.tile_rects = {{1.0 / 3, -2, 100.1, 50}, {}};
  source.heights.ellipsoid = true;
  source.heights.geoid_height_m = 44.7;
  EXPECT_EQ(SceneWith("\"source\": " + SceneSourceToJson(source)).source, source);
  EXPECT_EQ(SceneWith("\"source\": {}").source, SceneSource());
}

TEST(SceneSourceTest, WrongSourcesAreNamed) {
  EXPECT_THAT(FaultsWith("\"source\": 3"), ElementsAre(HasSubstr("source: found 3, expected an object")));
  EXPECT_THAT(FaultsWith(R"("source": {"crs": 1, "offset": [1, 2], "tiles": ["a", ""], "more": 1})"),
              ElementsAre(HasSubstr("source.crs"), HasSubstr("source.offset: found [1,2], expected three numbers"),
                          HasSubstr("source.tiles"), HasSubstr("unknown key 'more'")));
  EXPECT_THAT(FaultsWith(R"("source": {"tiles": ["a", "b", "c"],
                            "tile_rects": [[1, 2, 3], [0, 0, 1, 0], [0, "a", 1, 1]]})"),
              ElementsAre(HasSubstr("source.tile_rects[0]: found [1,2,3], expected null, or four numbers"),
                          HasSubstr("source.tile_rects[1]: found [0,0,1,0]"), HasSubstr("source.tile_rects[2]")));
  EXPECT_THAT(FaultsWith(R"("source": {"tiles": ["a"], "tile_rects": []})"),
              ElementsAre(HasSubstr("source.tile_rects: found [], expected a list with an entry for each of the 1 ")));
  EXPECT_THAT(FaultsWith(R"("source": {"heights": "geoid", "geoid_height_m": 1e9})"),
              ElementsAre(HasSubstr("source.heights: found \"geoid\", expected \"ellipsoid\""),
                          HasSubstr("source.geoid_height_m")));
  EXPECT_THAT(FaultsWith("\"source\": {\"crs\": \"" + std::string(70000, 'x') + "\"}"),
              ElementsAre(HasSubstr("source.crs")));
}

}  // namespace
}  // namespace tessera
