// Warnings about results that fit the images worse than the start.
#include "worker/publish/fit_summary.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace tessera {
namespace {

Survey NamedViews(int views) {
  Survey survey;
  survey.rotation_local_from_scene.setIdentity();
  survey.origin_in_scene = {1000, 2000, 0};
  for (int v = 0; v < views; ++v) survey.views.emplace_back().name = "image" + std::to_string(v) + ".jpg";
  return survey;
}

TEST(FitSummary, NamesTilesAndImagesThatBecameWorse) {
  FitOfTile good = {0, {}}, bad = {4, {}};
  good.fit.all = {100, 50, 90, 0, 40};
  good.fit.views[0] = good.fit.all;
  bad.fit.all = {100, 90, 30, 60, 0};
  bad.fit.views[1] = bad.fit.all;
  bad.fit.centre_m = {5, 6, 7};
  const Survey survey = NamedViews(2);
  const nlohmann::json summary = nlohmann::json::parse(FitSummary({good, bad}, survey));
  EXPECT_EQ(summary.at("patches"), 200);
  EXPECT_EQ(summary.at("worse"), false);  // 60 lost, 40 gained: two standard deviations
  ASSERT_EQ(summary.at("worse_tiles").size(), 1u);
  EXPECT_EQ(summary.at("worse_tiles")[0].at("tile"), 4);
  EXPECT_EQ(summary.at("worse_tiles")[0].at("centre")[1], 2006.0);
  ASSERT_EQ(summary.at("worse_images").size(), 1u);
  EXPECT_EQ(summary.at("worse_images")[0].at("image"), "image1.jpg");
  const Warnings warnings = FitWarnings({good, bad}, survey);
  ASSERT_EQ(warnings.size(), 2u);
  EXPECT_NE(warnings[0].find("tile 4 around (1005.0, 2006.0, 7.0)"), std::string::npos) << warnings[0];
  EXPECT_NE(warnings[1].find("image1.jpg"), std::string::npos) << warnings[1];
}

TEST(FitSummary, SaysThatTheWholeIsWorse) {
  FitOfTile bad = {0, {}};
  bad.fit.all = {100, 90, 30, 60, 0};
  EXPECT_EQ(nlohmann::json::parse(FitSummary({bad}, NamedViews(0))).at("worse"), true);
  EXPECT_NE(FitWarnings({bad}, NamedViews(0))[0].find("worse than the start mesh"), std::string::npos);
}

TEST(FitSummary, WithoutPatchesSaysNothing) {
  EXPECT_TRUE(FitWarnings({}, NamedViews(1)).empty());
  EXPECT_EQ(nlohmann::json::parse(FitSummary({}, NamedViews(1))).at("patches"), 0);
}

}  // namespace
}  // namespace tessera
