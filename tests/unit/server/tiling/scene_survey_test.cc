// What a job's plan would refuse, told from the scene alone.
#include "server/tiling/scene_survey.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/base/parallel.h"
#include "server/tiling/quote.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr double kGsd_m = 0.2;

struct SmallCity {
  SceneDescription scene;
  TriangleMesh mesh;
};

SmallCity MakeSmallCity() {
  const TinyScene tiny = MakeTinyScene();
  SmallCity city;
  city.mesh = tiny.mesh;
  city.scene.up_in_local = Eigen::Vector3d::UnitZ();
  city.scene.classes.resize(3);
  for (const PosedCamera& camera : tiny.cameras) {
    SceneView view;
    view.camera = camera;
    view.lens.pinhole = camera.intrinsics;
    city.scene.views.push_back(view);
  }
  return city;
}

TEST(SceneSurveyTest, CellsCoverTheMeshAndHaveViewsAndPairs) {
  const SmallCity city = MakeSmallCity();
  const Survey survey = EstimateSurvey(city.scene, city.mesh, kGsd_m);
  int64_t faces = 0;
  for (const SurveyCell& cell : survey.cells) {
    faces += cell.faces;
    EXPECT_GE(cell.faces, 1);
    EXPECT_FALSE(cell.views.empty());
  }
  EXPECT_EQ(faces, survey.faces);
  EXPECT_GE(faces, 4 * survey.input_faces) << "edges of 2 m have about 10 pixels: they are halved once";
  EXPECT_TRUE(CheckPairs({}, survey).ok()) << CheckPairs({}, survey);
  const StatusOr<Quote> quote = MakeQuote({}, survey);
  ASSERT_TRUE(quote.ok()) << quote.status();
  EXPECT_EQ(quote->tiles.size(), 1u);
  const ThreadLimit one(1);
  EXPECT_EQ(EstimateSurvey(city.scene, city.mesh, kGsd_m).pairs, survey.pairs);
}

TEST(SceneSurveyTest, OneImageAndImagesOfDifferentGroundHaveNoPair) {
  SmallCity city = MakeSmallCity();
  city.scene.views.resize(1);
  Survey survey = EstimateSurvey(city.scene, city.mesh, kGsd_m);
  EXPECT_THAT(std::string(CheckPairs({}, survey).message()),
              AllOf(HasSubstr("found 1 image, expected at least 2 images"), HasSubstr("3 are better")));
  JobSettings labels;
  labels.method = kLabelsMethod;
  EXPECT_TRUE(CheckPairs(labels, survey).ok()) << "labels need no pair";
  SceneView away = city.scene.views[0];
  away.camera.translation_cam_from_world += Eigen::Vector3d(1000, 0, 0);
  city.scene.views.push_back(away);
  survey = EstimateSurvey(city.scene, city.mesh, kGsd_m);
  EXPECT_THAT(std::string(CheckPairs({}, survey).message()), HasSubstr("2 images, no two of which show the same"));
}

TEST(SceneSurveyTest, ImagesTooLargeForTheMemoryAreNamed) {
  SmallCity city = MakeSmallCity();
  city.scene.has_likelihoods = true;
  PinholeCamera& camera = city.scene.views[0].camera.intrinsics;
  camera = camera.Resized(100 * camera.width, 100 * camera.height);
  city.scene.views[0].lens.pinhole = camera;
  const StatusOr<Quote> quote = MakeQuote({}, EstimateSurvey(city.scene, city.mesh, kGsd_m));
  EXPECT_EQ(quote.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(quote.status().message()),
              AllOf(HasSubstr("tile memory: found 4.00 GiB, expected at least"), HasSubstr("16000 x 12000 pixels"),
                    HasSubstr("raise --tile-memory, use images of half the size")));
}

}  // namespace
}  // namespace tessera
