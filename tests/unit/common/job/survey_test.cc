#include "common/job/survey.h"

#include <gtest/gtest.h>

#include "common/base/random.h"
#include "common/job/ground.h"
#include "common/job/task_parameters.h"

namespace tessera {
namespace {

Survey MakeSurvey() {
  Survey s;
  s.scene_name = "a \"quoted\" name";
  s.gsd_m = 0.1 / 3;
  s.ground = MakeGroundPlane(s.up, 2);
  s.cells = {{-1, 2, 17, 40, 0.3, {1, 2, 3}, {4, 5, 6}, {0}}, {0, 2, 1, 0, 0, {0, 0, 0}, {1, 1, 1}, {}}};
  s.views.resize(1);
  s.views[0].name = "a.jpg";
  s.views[0].image_path = "images/a.jpg";
  s.views[0].lens.kind = LensModel::Kind::kOpenCv;
  s.views[0].lens.coefficients[1] = 1.0 / 7;
  s.views[0].camera.translation_cam_from_world = {1.0 / 3, 2, 3};
  s.pairs = {{0, 0}};
  s.classes.resize(2);
  s.classes[1].name = "roof";
  s.classes[1].prior_alpha_rad = 1.0 / 9;
  s.classes[1].smoothness = 1.0 / 11;
  s.classes[1].anchor_weight = 1.0 / 17;
  s.borders = BorderTrusts(2);
  s.borders.Set(0, 1, {1.0 / 13, 0.5, 1.0 / 3});
  s.warnings = {"something odd"};
  FillViewDepths(&s);
  return s;
}

TEST(Survey, KeepsHowPhotographsAreRead) {
  Survey survey = MakeSurvey();
  const std::string plain = SurveyToJson(survey);
  EXPECT_EQ(plain.find("mask"), std::string::npos);
  EXPECT_EQ(plain.find("white_level"), std::string::npos);
  survey.views[0].mask_path = "masks/a.png";
  survey.views[0].masked = true;
  survey.views[0].white_level = 4095;
  survey.views[0].lens.kind = LensModel::Kind::kBrown;
  survey.views[0].lens.coefficients[6] = 1.0 / 3;
  const StatusOr<Survey> parsed = ParseSurvey(SurveyToJson(survey));
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->views[0].mask_path, "masks/a.png");
  EXPECT_TRUE(parsed->views[0].masked);
  EXPECT_EQ(parsed->views[0].white_level, 4095);
  EXPECT_EQ(parsed->views[0].lens, survey.views[0].lens);
  EXPECT_EQ(WithoutNames(survey).views[0].mask_path, ViewMaskName(0));
}

TEST(Survey, JsonRoundTripKeepsEveryBit) {
  const std::string json = SurveyToJson(MakeSurvey());
  const StatusOr<Survey> parsed = ParseSurvey(json);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(SurveyToJson(*parsed), json);
  EXPECT_EQ(parsed->gsd_m, MakeSurvey().gsd_m);
  EXPECT_EQ(parsed->views[0].camera.translation_cam_from_world,
            MakeSurvey().views[0].camera.translation_cam_from_world);
  EXPECT_EQ(parsed->views[0].lens.coefficients[1], 1.0 / 7);
  EXPECT_EQ(parsed->classes[1].smoothness, 1.0 / 11);
  EXPECT_EQ(parsed->classes[1].anchor_weight, 1.0 / 17);
  EXPECT_EQ(parsed->borders, MakeSurvey().borders);
}

TEST(Survey, FitIsKeptForTheReportAlone) {
  EXPECT_EQ(SurveyToJson(MakeSurvey()).find("\"fit\""), std::string::npos);
  Survey survey = MakeSurvey();
  survey.fit = R"({"above_chance":0.5})";
  const StatusOr<Survey> parsed = ParseSurvey(SurveyToJson(survey));
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->fit, survey.fit);
  EXPECT_EQ(SurveyToJson(WithoutNames(survey)), SurveyToJson(WithoutNames(MakeSurvey())));
  PublishParameters publish;
  publish.fit = survey.fit;
  EXPECT_EQ(ParsePublishParameters(ToJson(publish))->fit, survey.fit);
}

TEST(Survey, LabelPropertyIsKeptIfItIsSet) {
  EXPECT_EQ(SurveyToJson(MakeSurvey()).find("label_property"), std::string::npos);
  for (const char* const property : {"class", ""}) {
    Survey survey = MakeSurvey();
    survey.label_property = property;
    const StatusOr<Survey> parsed = ParseSurvey(SurveyToJson(survey));
    ASSERT_TRUE(parsed.ok()) << parsed.status();
    EXPECT_EQ(parsed->label_property, property);
    EXPECT_EQ(SurveyToJson(WithoutNames(survey)), SurveyToJson(WithoutNames(MakeSurvey())));
  }
}

TEST(Survey, FormsOfLikelihoodsAreKeptIfTheyAreSpecial) {
  EXPECT_EQ(SurveyToJson(MakeSurvey()).find("likelihood_form"), std::string::npos);
  Survey survey = MakeSurvey();
  LikelihoodForm form = {LikelihoodForm::Layout::kClassesLast, LikelihoodForm::Values::kLogits, 1, {{1, 2, 3}}};
  survey.views[0].likelihood_form = form;
  const StatusOr<Survey> parsed = ParseSurvey(SurveyToJson(WithoutNames(survey)));
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->views[0].likelihood_form, form);
  form.first_id.reset();
  survey.views[0].likelihood_form = form;
  EXPECT_EQ(ParseSurvey(SurveyToJson(survey))->views[0].likelihood_form, form);
}

TEST(Survey, SurveysBeforeAnchorWeightsParseAsZero) {
  std::string json = SurveyToJson(MakeSurvey());
  for (size_t at = json.find("\"keep\":"); at != std::string::npos; at = json.find("\"keep\":")) {
    json.erase(at, json.find(',', at) + 1 - at);
  }
  const StatusOr<Survey> parsed = ParseSurvey(json);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->classes[1].anchor_weight, 0);
  EXPECT_EQ(parsed->classes[1].smoothness, 1.0 / 11);
}

TEST(Survey, RejectsForeignJson) {
  EXPECT_FALSE(ParseSurvey("").ok());
  EXPECT_FALSE(ParseSurvey("{}").ok());
  Survey survey = MakeSurvey();
  survey.cells[0].views = {1};
  EXPECT_FALSE(ParseSurvey(SurveyToJson(survey)).ok()) << "there is only view 0";
  survey = MakeSurvey();
  survey.classes.resize(1);
  EXPECT_FALSE(ParseSurvey(SurveyToJson(survey)).ok()) << "a border of a second class";
  survey = MakeSurvey();
  survey.borders.Set(0, 1, {0, 1, 1.5});
  EXPECT_FALSE(ParseSurvey(SurveyToJson(survey)).ok()) << "a weight above 1";
  survey = MakeSurvey();
  survey.pairs = {{0, -1}};
  EXPECT_FALSE(ParseSurvey(SurveyToJson(survey)).ok());
  survey = MakeSurvey();
  survey.view_depths.clear();
  EXPECT_FALSE(ParseSurvey(SurveyToJson(survey)).ok());
}

TEST(Survey, PlainSurveysContainNoNames) {
  const Survey survey = MakeSurvey();
  Survey renamed = survey;
  renamed.scene_name = "other";
  renamed.mesh_path = "m.ply";
  renamed.flights = {{"next", "2027-01-01"}};
  renamed.warnings = {"beware"};
  for (SceneView& view : renamed.views) {
    view.name += "x";
    view.image_path += "x";
    view.flight = 0;
  }
  EXPECT_EQ(SurveyToJson(WithoutNames(survey)), SurveyToJson(WithoutNames(renamed)));
  renamed.views[0].image_content = "others";
  EXPECT_NE(SurveyToJson(WithoutNames(survey)), SurveyToJson(WithoutNames(renamed))) << "pixels do count";
}

TEST(Survey, SkippedImagesReachTheReportButNoOtherTask) {
  Survey survey = MakeSurvey();
  const std::string without = SurveyToJson(survey), plain = SurveyToJson(WithoutNames(survey));
  survey.skipped_images = {{"a.jpg", "no such file"}};
  EXPECT_NE(SurveyToJson(survey), without);
  EXPECT_EQ(ParseSurvey(SurveyToJson(survey))->skipped_images, survey.skipped_images);
  EXPECT_EQ(SurveyToJson(WithoutNames(survey)), plain);
  PublishParameters publish;
  publish.skipped_images = survey.skipped_images;
  EXPECT_EQ(ParsePublishParameters(ToJson(publish))->skipped_images, survey.skipped_images);
  IngestParameters ingest;
  ingest.skip_images = 0.1;
  ingest.anyway = true;
  const StatusOr<IngestParameters> parsed = ParseIngestParameters(ToJson(ingest));
  EXPECT_EQ(parsed->skip_images, 0.1);
  EXPECT_TRUE(parsed->anyway);
  EXPECT_EQ(ToJson(IngestParameters()), "{}") << "keys of earlier jobs";
}

TEST(Survey, UpdatesOnlyWidenViewDepths) {
  Survey survey = MakeSurvey();
  const auto before = survey.view_depths;
  for (SurveyCell& cell : survey.cells) cell.views.clear();
  FillViewDepths(&survey);
  EXPECT_EQ(survey.view_depths, before);
}

TEST(TaskParameters, RoundTrip) {
  CutParameters cut = {{7, {-3, 0, 4, 5}}, {{0, 0, 1, 1}, {-3, 0, 4, 5}}, 9, 3};
  const auto parsed = ParseCutParameters(ToJson(cut));
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->tile.core, cut.tile.core);
  EXPECT_EQ(parsed->cores, cut.cores);
  EXPECT_EQ(parsed->window_px, 9);
  EXPECT_EQ(parsed->coarsest_level, 3);
  EXPECT_EQ(ToJson(*parsed), ToJson(cut));
  EXPECT_TRUE(parsed->fine_iterations.empty());
  cut.fine_iterations = {6, 3};
  cut.max_step_px = 0.7;
  EXPECT_EQ(ParseCutParameters(ToJson(cut))->fine_iterations, cut.fine_iterations);
  EXPECT_EQ(ParseCutParameters(ToJson(cut))->max_step_px, 0.7);
  const PublishParameters publish = {{{0, {0, 0, 1, 1}}}};
  EXPECT_EQ(ToJson(*ParsePublishParameters(ToJson(publish))), ToJson(publish));
  ChangesParameters changes = {{{0, 0, 96, 96}}, {1, 2}, "town"};
  EXPECT_EQ(ToJson(*ParseChangesParameters(ToJson(changes))), ToJson(changes));
  changes.outdated = true;
  EXPECT_TRUE(ParseChangesParameters(ToJson(changes))->outdated);
  PublishParameters update = publish;
  update.outdated = true;
  EXPECT_TRUE(ParsePublishParameters(ToJson(update))->outdated);
  EXPECT_FALSE(ParsePublishParameters(ToJson(update))->flip_edges);
  update.flip_edges = true;
  EXPECT_TRUE(ParsePublishParameters(ToJson(update))->flip_edges);
  EXPECT_FALSE(ParsePublishParameters(ToJson(publish))->outdated);
  EXPECT_EQ(ToJson(*ParseRefineParameters(ToJson(RefineParameters{2, "tessera"}))),
            ToJson(RefineParameters{2, "tessera"}));
  EXPECT_FALSE(ParseCutParameters("{}").ok());
  StepParameters step = {2, "paper", {}, 7, true, {1, {0, 0, 1, 1}}, {0, 1}, {1}};
  step.settings.inter = 0.5;
  EXPECT_EQ(ToJson(*ParseStepParameters(ToJson(step))), ToJson(step));
  EXPECT_TRUE(ParseStepParameters(ToJson(step))->before);
  EXPECT_FALSE(ParseStepParameters("{}").ok());
}

TEST(TaskParameters, ParseTileReadsRequiresCanonicalJson) {
  const TileReads reads = {{1, 2}, {2}, {0, 1, 2}, {2, 3}};
  const std::string json = ToJson(reads);
  EXPECT_EQ(json, R"({"label":[1,2],"mend":[2],"sight":[0,1,2],"solve":[2,3]})");
  EXPECT_EQ(*ParseTileReads(json, 2, 4), reads);
  EXPECT_EQ(ParseTileReads(json, 2, 3).status().code(), absl::StatusCode::kInvalidArgument) << "there is no tile 3";
  EXPECT_EQ(ParseTileReads(json, 1, 4).status().code(), absl::StatusCode::kInvalidArgument) << "it lacks the tile";
  for (const char* bad : {"", "[]", "{}", "null", R"({"label":[2],"mend":[2],"sight":[2]})",
                          R"({"label":[2,2],"mend":[2],"sight":[2],"solve":[2]})",
                          R"({"label":[2,1],"mend":[2],"sight":[2],"solve":[2]})",
                          R"({"label":[-1,2],"mend":[2],"sight":[2],"solve":[2]})",
                          R"({"label":[2.0],"mend":[2],"sight":[2],"solve":[2]})",
                          R"({"label":[true,2],"mend":[2],"sight":[2],"solve":[2]})",
                          R"({"label":["2"],"mend":[2],"sight":[2],"solve":[2]})",
                          R"({"label":[4294967298],"mend":[2],"sight":[2],"solve":[2]})",
                          R"({"label":[2],"mend":[2],"more":[2],"sight":[2],"solve":[2]})",
                          R"({"label": [2],"mend":[2],"sight":[2],"solve":[2]})"}) {
    EXPECT_EQ(ParseTileReads(bad, 2, 4).status().code(), absl::StatusCode::kInvalidArgument) << bad;
  }
}

TEST(Ground, AxesAreOrthonormalAndRightHanded) {
  Random random(1);
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector3d up = Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal()).normalized();
    const GroundPlane g = MakeGroundPlane(up, 1);
    EXPECT_NEAR(g.axis_x.cross(g.axis_y).dot(up), 1, 1e-12);
    EXPECT_NEAR(g.axis_x.dot(g.axis_y), 0, 1e-12);
  }
}

TEST(Ground, DistancesToRectangles) {
  const CellRect rect = {0, 0, 2, 1};
  EXPECT_EQ(DistanceToRect({3, 0.5}, rect, 2), 0);
  EXPECT_EQ(DistanceToRect({7, 6}, rect, 2), 5);
  EXPECT_EQ(DistanceBetween(rect, {2, 1, 3, 3}, 2), 0);
  EXPECT_EQ(DistanceBetween(rect, {5, 5, 6, 6}, 2), 10);
}

}  // namespace
}  // namespace tessera
