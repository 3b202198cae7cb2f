// Views of an update: matched with the base's, added, withdrawn.
#include "worker/city/update_survey.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// Nadir view from 100 m above (x, 0): 0.1 px are 1 cm on the ground.
SceneView View(const std::string& name, const std::string& content, double x_m) {
  SceneView view;
  view.name = name;
  view.image_path = "images/" + name;
  view.image_content = content;
  view.flight = 0;
  view.lens.pinhole = view.camera.intrinsics = {1000, 800, 1000, 1000, 500, 400};
  view.camera.rotation_cam_from_world = Eigen::Vector3d(1, -1, -1).asDiagonal();
  view.camera.translation_cam_from_world = -(view.camera.rotation_cam_from_world * Eigen::Vector3d(x_m, 0, 100));
  return view;
}

Survey Base() {
  Survey survey;
  survey.gsd_m = 0.1;
  survey.ground = MakeGroundPlane(survey.up, 8);
  survey.flights = {{"spring", "2026-05-01"}};
  survey.views = {View("a", "A", 0), View("b", "B", 20), View("c", "C", 40)};
  SurveyCell cell;
  cell.box_min = {-5, -5, 0};
  cell.box_max = {45, 5, 10};
  cell.views = {0, 1, 2};
  survey.cells = {cell};
  survey.pairs = {{0, 1}, {1, 0}};
  FillViewDepths(&survey);
  return survey;
}

SceneDescription Scene(std::vector<SceneView> views) {
  SceneDescription scene;
  scene.folder = "scene";
  scene.flights = {{"next", "2027-05-01"}};
  scene.views = std::move(views);
  return scene;
}

TEST(UpdateSurvey, ViewsAreMatchedByContentNotByName) {
  Survey survey = Base();
  const auto changes = UpdateViews(
      Scene({View("z", "B", 20), View("y", "A", 0), View("new", "N", 60), View("b", "C", 40)}), true, {}, {}, &survey);
  ASSERT_TRUE(changes.ok()) << changes.status();
  EXPECT_THAT(changes->changed, ElementsAre(0, 0, 0, 1));
  EXPECT_EQ(changes->added, 1);
  EXPECT_EQ(survey.views[0].name, "y");
  EXPECT_EQ(survey.views[1].image_path, "images/z");
  EXPECT_EQ(survey.views[2].name, "b") << "named as another of the base";
  EXPECT_EQ(survey.views[3].name, "new");
  EXPECT_EQ(survey.flights[survey.views[3].flight].name, "next");
}

TEST(UpdateSurvey, WholeSceneWithdrawsMissingViewsAndDeltaKeepsThem) {
  for (const bool whole : {true, false}) {
    Survey survey = Base();
    const auto changes = UpdateViews(Scene({View("a", "A", 0)}), whole, {}, {{"images/b", ".base/b"}}, &survey);
    ASSERT_TRUE(changes.ok()) << changes.status();
    EXPECT_EQ(changes->withdrawn, whole ? 2 : 0);
    EXPECT_EQ(survey.views.size(), 3u) << "numbers stay";
    EXPECT_EQ(survey.views[1].withdrawn, whole);
    EXPECT_EQ(survey.views[1].image_path, whole ? "" : ".base/b");
    EXPECT_EQ(survey.views[2].image_path, whole ? "" : "images/c");
    EXPECT_EQ(changes->changed[1], whole);
  }
}

TEST(UpdateSurvey, SmallPoseChangesKeepTheBasePose) {
  for (const double moved_m : {0.004, 0.05}) {
    Survey survey = Base();
    const PosedCamera before = survey.views[0].camera;
    SceneDescription scene = Scene({View("a", "A", moved_m), View("b", "B", 20), View("c", "C", 40)});
    const auto changes = UpdateViews(scene, true, {}, {}, &survey);
    ASSERT_TRUE(changes.ok()) << changes.status();
    const bool snaps = moved_m < 0.009;  // 0.1 px from 90 m above the highest visible point
    EXPECT_EQ(changes->snapped, snaps);
    EXPECT_EQ(changes->moved, !snaps);
    EXPECT_EQ(changes->changed[0], !snaps);
    EXPECT_EQ(survey.views[0].camera.translation_cam_from_world == before.translation_cam_from_world, snaps);
  }
}

TEST(UpdateSurvey, ChangedLensCountsAsMoved) {
  for (const double k1 : {1e-6, 1e-3}) {
    Survey survey = Base();
    SceneDescription scene = Scene({View("a", "A", 0), View("b", "B", 20), View("c", "C", 40)});
    scene.views[0].lens.kind = LensModel::Kind::kSimpleRadial;
    scene.views[0].lens.coefficients[0] = k1;
    const auto changes = UpdateViews(scene, true, {}, {}, &survey);
    ASSERT_TRUE(changes.ok()) << changes.status();
    EXPECT_EQ(changes->moved, k1 > 1e-4) << "by a quarter of a pixel in the corners, or none that shows";
    EXPECT_EQ(survey.views[0].lens.coefficients[0], k1 > 1e-4 ? k1 : 0);
  }
}

TEST(UpdateSurvey, ContentTakesPrecedenceOverNameInAnyOrder) {
  // "a" was taken again, and the image of that name in the base is "d" now.
  for (const bool first : {true, false}) {
    Survey survey = Base();
    std::vector<SceneView> views = {View("a", "retaken", 0), View("d", "A", 0), View("b", "B", 20), View("c", "C", 40)};
    if (!first) std::swap(views[0], views[1]);
    const auto changes = UpdateViews(Scene(views), true, {}, {}, &survey);
    ASSERT_TRUE(changes.ok()) << changes.status();
    EXPECT_EQ(survey.views[0].name, "d");
    EXPECT_EQ(changes->added, 1);
    EXPECT_EQ(changes->replaced, 0);
  }
}

TEST(UpdateSurvey, WholeSceneReplacesViewsWithNewContentUnderTheSameName) {
  for (const bool whole : {true, false}) {
    Survey survey = Base();
    const auto changes =
        UpdateViews(Scene({View("a", "other", 0), View("b", "B", 20), View("c", "C", 40)}), whole, {}, {}, &survey);
    ASSERT_TRUE(changes.ok()) << changes.status();
    EXPECT_EQ(changes->replaced, whole);
    EXPECT_EQ(changes->added, !whole) << "a delta only adds";
    EXPECT_EQ(survey.views[0].image_content, whole ? "other" : "A");
  }
}

TEST(UpdateSurvey, FlightsAreWithdrawnByName) {
  Survey survey = Base();
  const SceneDescription scene = Scene({View("new", "N", 60)});
  const auto changes = UpdateViews(scene, false, {.ingest = {}, .withdraw = {"spring"}}, {}, &survey);
  ASSERT_TRUE(changes.ok()) << changes.status();
  EXPECT_EQ(changes->withdrawn, 3);
  EXPECT_TRUE(survey.views[2].withdrawn);
  EXPECT_FALSE(survey.views[3].withdrawn);
  survey = Base();
  const auto unknown = UpdateViews(scene, false, {.ingest = {}, .withdraw = {"autumn"}}, {}, &survey);
  EXPECT_THAT(unknown.status().message(),
              HasSubstr("found flight 'autumn', expected a flight of the base job: 'spring'"));
  survey = Base();
  EXPECT_THAT(UpdateViews(Scene({}), false, {.ingest = {}, .withdraw = {"spring"}}, {}, &survey).status().message(),
              HasSubstr("all images of the base job are withdrawn"));
}

TEST(UpdateSurvey, NewImagesWithoutAFlightFormOneFlight) {
  Survey survey = Base();
  SceneDescription scene = Scene({View("n", "N", 60), View("m", "M", 80)});
  scene.name = "next";
  scene.flights.clear();
  for (SceneView& view : scene.views) view.flight = -1;
  ASSERT_TRUE(UpdateViews(scene, false, {}, {}, &survey).ok());
  ASSERT_EQ(survey.flights.size(), 2u);
  EXPECT_EQ(survey.flights[1].name, "next");
  EXPECT_EQ(survey.views[3].flight, 1);
  EXPECT_EQ(survey.views[4].flight, 1);
}

TEST(UpdateSurvey, ClassesAndLikelihoodsMustMatchTheBase) {
  Survey survey = Base();
  SceneDescription scene = Scene({View("new", "N", 60)});
  scene.has_likelihoods = true;
  EXPECT_THAT(UpdateViews(scene, false, {}, {}, &survey).status().message(), HasSubstr("none, as in the base job"));
  survey.has_likelihoods = true;
  survey.classes.resize(1);
  survey.classes[0].name = "ground";
  scene.classes.resize(1);
  scene.classes[0].name = "water";
  EXPECT_THAT(UpdateViews(scene, false, {}, {}, &survey).status().message(), HasSubstr("ground, as in the base job"));
}

}  // namespace
}  // namespace tessera
