#include "worker/publish/job_summary.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "common/exporting/export_scene.h"
#include "common/exporting/survey_sheets.h"
#include "common/scene/scene_json.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

Survey ImportedSurvey() {
  Survey survey;
  survey.crs.kind = Crs::Kind::kUtm;
  survey.crs.zone = 32;
  survey.origin_in_scene = {691200, 5334016, 1024.0 / 3};
  survey.up = Eigen::Vector3d(0.1, -0.2, 1).normalized();
  survey.gsd_m = 0.1 + 0.2;
  survey.ground = MakeGroundPlane(survey.up, 16);
  survey.classes = {OneClass()};
  survey.source = SceneSourceToJson({"EPSG:32632", {691000.5, 0, 1}, {"Tile_+000_+000"}});
  return survey;
}

TEST(JobSummaryTest, ReportHasTheFrameForExports) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  Survey survey = ImportedSurvey();
  auto statistics = ResultStatistics::Create(folder.path(), survey.classes.size());
  ASSERT_TRUE(statistics.ok()) << statistics.status();
  survey.views.resize(2);
  survey.views[0].name = "a.jpg";
  survey.views[1].name = "b.jpg";
  survey.cells.emplace_back().views = {1};
  const StatusOr<std::string> report = MakeReport(survey, *std::move(statistics), {});
  ASSERT_TRUE(report.ok()) << report.status();
  const StatusOr<ExportScene> scene = ParseExportScene(nlohmann::json::parse(*report).at("frame").dump());
  ASSERT_TRUE(scene.ok()) << scene.status();
  const auto views = ParseViewNames(nlohmann::json::parse(*report).at("views_of_sheets").dump());
  ASSERT_TRUE(views.ok()) << views.status();
  EXPECT_EQ(views->size(), 1u);
  EXPECT_THAT(views->at({0, 0}), testing::ElementsAre("b.jpg"));
  EXPECT_EQ(scene->frame.crs(), survey.crs);
  EXPECT_EQ(scene->frame.origin_in_scene(), survey.origin_in_scene);
  EXPECT_EQ(scene->up, survey.up);
  EXPECT_EQ(scene->gsd_m, survey.gsd_m);
  EXPECT_EQ(scene->ground.axis_x, survey.ground.axis_x);
  EXPECT_EQ(scene->ground.cell_m, survey.ground.cell_m);
  ASSERT_TRUE(scene->source.has_value());
  EXPECT_THAT(scene->source->tiles, testing::ElementsAre("Tile_+000_+000"));
  ASSERT_EQ(scene->classes.size(), 1u);
  EXPECT_EQ(scene->classes[0].name, survey.classes[0].name);
}

TEST(JobSummaryTest, DamagedSourceIsAnError) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  Survey survey = ImportedSurvey();
  survey.source = "{";
  auto statistics = ResultStatistics::Create(folder.path(), survey.classes.size());
  ASSERT_TRUE(statistics.ok()) << statistics.status();
  EXPECT_FALSE(MakeReport(survey, *std::move(statistics), {}).ok());
}

}  // namespace
}  // namespace tessera
