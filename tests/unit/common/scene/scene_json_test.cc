#include "common/scene/scene_json.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kDegree = std::numbers::pi / 180;

std::vector<std::string> FaultsOf(const std::string& text) {
  Faults faults;
  ParseSceneFile(text, "scene.json", &faults);
  return faults.messages();
}
SceneFile Parse(const std::string& text) {
  Faults faults;
  SceneFile file = ParseSceneFile(text, "scene.json", &faults);
  EXPECT_THAT(faults.messages(), IsEmpty());
  return file;
}

TEST(SceneJsonTest, TakesFilesFromWindows) {
  const SceneFile file = Parse("\xef\xbb\xbf{\r\n\t\"tessera_scene\": 1,\r\n\t\"name\": \"a city\"\r\n}\r\n");
  EXPECT_EQ(file.name, "a city");
}

TEST(SceneJsonTest, MinimalSceneUsesDefaults) {
  const SceneFile file = Parse(R"({"tessera_scene": 1})");
  EXPECT_EQ(file.cameras.path, "colmap");
  EXPECT_FALSE(file.cameras.given);
  EXPECT_EQ(file.mesh.path, "mesh.ply");
  ASSERT_EQ(file.classes.size(), 4u);
  EXPECT_EQ(file.classes[0].name, "ground");
  EXPECT_DOUBLE_EQ(file.classes[1].prior_beta_rad, 90 * kDegree);
  EXPECT_DOUBLE_EQ(file.classes[2].prior_alpha_rad, 60 * kDegree);
  EXPECT_DOUBLE_EQ(file.classes[3].prior_alpha_rad, 180 * kDegree);
  EXPECT_EQ(file.crs.kind, Crs::Kind::kLocal);
  EXPECT_FALSE(file.up.has_value());
  ASSERT_EQ(file.flights.size(), 1u);
}

TEST(SceneJsonTest, EveryKeyIsRead) {
  const SceneFile file = Parse(R"({"tessera_scene": 1, "name": "a", "cameras": "c", "images": "i", "likelihoods": "l",
    "masks": "k", "mesh": "m.ply",
    "classes": [{"name": "roof", "color": "#0a0B0c", "smoothness": 2, "anchor_weight": 0.5},
    {"name": "water", "prior_alpha_deg": 10, "prior_beta_deg": 5}, "ground"],
    "crs": {"type": "enu", "lat_deg": 52.5, "lon_deg": 7, "height_m": 40}, "up": [0, 3, 4],
    "flights": [{"name": "spring", "date": "2026-05-14", "images": ["s*"]}, {"name": "rest"}]})");
  EXPECT_EQ(file.name, "a");
  EXPECT_TRUE(file.mesh.given);
  EXPECT_EQ(file.masks.path, "k");
  EXPECT_EQ(file.classes[0].color_rgb, (std::array<uint8_t, 3>{10, 11, 12}));
  EXPECT_EQ(file.classes[0].smoothness, 2);
  EXPECT_EQ(file.classes[0].anchor_weight, 0.5);
  EXPECT_EQ(file.classes[1].anchor_weight, 0);
  EXPECT_DOUBLE_EQ(file.classes[0].prior_alpha_rad, 60 * kDegree);  // a known name's default
  EXPECT_DOUBLE_EQ(file.classes[1].prior_alpha_rad, 10 * kDegree);
  EXPECT_EQ(file.classes[2].name, "ground");
  EXPECT_EQ(file.crs.kind, Crs::Kind::kEnu);
  EXPECT_DOUBLE_EQ(file.crs.lat_rad, 52.5 * kDegree);
  EXPECT_NEAR((*file.up - Eigen::Vector3d(0, 0.6, 0.8)).norm(), 0, 1e-15);
  EXPECT_THAT(file.flights[0].patterns, ElementsAre("s*"));
  EXPECT_THAT(file.flights[1].patterns, ElementsAre("*"));
}

TEST(SceneJsonTest, FormOfLikelihoods) {
  EXPECT_EQ(Parse(R"({"tessera_scene": 1})").likelihood_form, LikelihoodForm());
  const SceneFile file = Parse(R"({"tessera_scene": 1, "likelihood_layout": "hwc", "likelihood_values": "logits",
    "likelihood_first_id": 1})");
  EXPECT_EQ(file.likelihood_form,
            (LikelihoodForm{LikelihoodForm::Layout::kClassesLast, LikelihoodForm::Values::kLogits, 1, {}}));
  const SceneFile other = Parse(R"({"tessera_scene": 1, "likelihood_layout": "chw",
    "likelihood_values": "probabilities", "likelihood_first_id": 0})");
  EXPECT_EQ(other.likelihood_form,
            (LikelihoodForm{LikelihoodForm::Layout::kClassesFirst, LikelihoodForm::Values::kProbabilities, 0, {}}));
  for (const char* const wrong : {"\"likelihood_layout\": \"hw\"", "\"likelihood_values\": 1",
                                  "\"likelihood_first_id\": 2", "\"likelihood_first_id\": \"1\""}) {
    Faults faults;
    ParseSceneFile(std::string("{\"tessera_scene\": 1, ") + wrong + "}", "scene.json", &faults);
    EXPECT_EQ(faults.messages().size(), 1u) << wrong;
  }
}

TEST(SceneJsonTest, LabelProperty) {
  EXPECT_FALSE(Parse(R"({"tessera_scene": 1})").label_property.has_value());
  EXPECT_EQ(Parse(R"({"tessera_scene": 1, "label_property": "class"})").label_property, "class");
  EXPECT_EQ(Parse(R"({"tessera_scene": 1, "label_property": null})").label_property, "");
  for (const char* const wrong : {"\"\"", "3", "[\"class\"]"}) {
    EXPECT_THAT(FaultsOf(std::string(R"({"tessera_scene": 1, "label_property": )") + wrong + "}"),
                ElementsAre(HasSubstr("label_property: found " + std::string(wrong) +
                                      ", expected the name of a property, or null for no labels")));
  }
}

TEST(SceneJsonTest, SyntaxErrorsHaveLineAndColumn) {
  EXPECT_THAT(FaultsOf("{\n  \"tessera_scene\": 1,\n  \"name\": oops\n}"),
              ElementsAre(HasSubstr("scene.json: line 3, column 11: found syntax error")));
  EXPECT_THAT(FaultsOf("{\n\n"), ElementsAre(HasSubstr("scene.json: line 3, column 1")));
  EXPECT_THAT(FaultsOf(""), ElementsAre(HasSubstr("line 1, column 1")));
}

TEST(SceneJsonTest, NestingIsBounded) {
  const std::string deep(100'000, '['), end(100'000, ']');
  EXPECT_THAT(FaultsOf("{\"tessera_scene\": 1, \"name\": " + deep + end + "}"),
              ElementsAre(HasSubstr("scene.json: found JSON nested 100001 levels deep, expected at most 64 levels")));
}

TEST(SceneJsonTest, ReportsAllFaultsWithTheirKeys) {
  EXPECT_THAT(FaultsOf(R"({"tessera_scene": 2, "mash": "x", "mesh": 3, "images": "../else", "up": [0, 0, 0],
    "classes": ["ground", "grund", "ground", {"name": "a", "color": "red"}, {"name": "b", "colour": "#000000"}],
    "crs": {"type": "utm", "zone": 61}, "flights": [{"name": "f", "date": "May"}]})"),
              testing::UnorderedElementsAre(
                  HasSubstr("tessera_scene: found 2, expected 1"), HasSubstr("unknown key 'mash'"),
                  HasSubstr("mesh: found 3, expected a string"), HasSubstr("images: found \"../else\""),
                  HasSubstr("up: found [0,0,0]"), HasSubstr("classes[1]: found \"grund\""),
                  HasSubstr("classes[2]: found class 'ground' again"), HasSubstr("classes[3].color: found \"red\""),
                  HasSubstr("classes[4]: found unknown key 'colour'"), HasSubstr("crs.zone: found 61"),
                  HasSubstr("flights[0].date: found \"May\"")));
  EXPECT_THAT(FaultsOf(R"({"tessera_scene": 1, "crs": {"type": "enu", "lat_deg": 4}})"),
              ElementsAre(HasSubstr("no lon_deg")));
  EXPECT_THAT(FaultsOf(R"({"tessera_scene": 1, "crs": {"type": "rd"}})"),
              ElementsAre(HasSubstr("found 'rd', expected local, enu")));
  EXPECT_THAT(FaultsOf(R"([1])"), ElementsAre(HasSubstr("a JSON object")));
  EXPECT_THAT(FaultsOf(R"({})"), ElementsAre(HasSubstr("tessera_scene: found nothing")));
}

}  // namespace
}  // namespace tessera
