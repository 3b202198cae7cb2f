// What the fit of images, the 3D points and their table say.
#include "common/check/fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "common/colmap/calibrated_images.h"
#include "common/check/fit_findings.h"
#include "common/check/tie_points.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::SizeIs;

class ChangedSceneTest : public testing::Test {
 protected:
  void SetUp() override {
    TinySceneOptions options;
    options.tower = true;
    const std::string folder = FreshTestFolder("fit_table");
    WriteTinyScene(folder, options);
    scene_ = *LoadScene(folder, &warnings_);
    mesh_ = *LoadSceneMesh(scene_, 0);
    gsd_m_ = *MedianGsd(scene_, mesh_);
  }
  // What a user is told of the fit.
  std::string ToldOfFit() {
    Warnings warnings;
    const StatusOr<JudgedFit> judged = CheckFit(scene_, mesh_, gsd_m_, true, {}, &warnings);
    EXPECT_TRUE(judged.ok()) << judged.status();
    std::string text = judged.ok() ? std::string(judged->fault.message()) : "";
    for (const std::string& warning : warnings) text += "\n" + warning;
    return text;
  }

  Warnings warnings_;
  SceneDescription scene_;
  TriangleMesh mesh_;
  double gsd_m_ = 0;
};

TEST_F(ChangedSceneTest, MeshMovedAsideIsToldOf) {
  for (Eigen::Vector3d& p : mesh_.vertices) p.x() += 3;
  EXPECT_THAT(ToldOfFit(), HasSubstr("if it were moved by (-"));
}

TEST_F(ChangedSceneTest, FacesThatAreOrientedInwardsAreToldOf) {
  for (Triangle& face : mesh_.faces) std::swap(face[1], face[2]);
  EXPECT_THAT(ToldOfFit(), HasSubstr("oriented inwards: turn them"));
}

TEST_F(ChangedSceneTest, SurfaceOfACoarseMeshIsMeasuredAtItsOwnPoints) {
  TriangleMesh coarse = mesh_;
  for (Eigen::Vector3d& p : coarse.vertices) p.z() += 0.3;
  const StatusOr<SceneFit> fit = MeasureFit(scene_, {mesh_, coarse, 0.5}, {}, {});
  ASSERT_TRUE(fit.ok()) << fit.status();
  EXPECT_GT(fit->all.above_chance, 0.8);
}

TEST_F(ChangedSceneTest, TableHasAllCamerasAndTheWorstImagesFirst) {
  SceneFit fit = *MeasureFit(scene_, mesh_, {}, {});
  fit.misplaced = {1};
  const FitTable table = MakeFitTable(scene_, fit, nullptr);
  EXPECT_THAT(table.cameras, SizeIs(fit.cameras.size()));
  ASSERT_THAT(table.images, SizeIs(scene_.views.size()));
  EXPECT_EQ(table.images[0].name, scene_.views[1].name);
  EXPECT_THAT(FitTableToText(table, 2), AllOf(HasSubstr("(2 of "), HasSubstr("disagrees")));
  EXPECT_THAT(FitTableToJson(table, 1), AllOf(HasSubstr(scene_.views[1].name), Not(HasSubstr(scene_.views[2].name))));
}

CalibratedImages ModelWithPoints() {
  CalibratedImages model;
  model.cameras[1].pinhole = {100, 100, 100, 100, 50, 50};
  for (uint64_t p = 0; p < 20; ++p) {
    model.points.push_back({p, {0.1 * static_cast<double>(p) - 1, 0.05 * static_cast<double>(p % 7), 10}, {}});
  }
  for (uint32_t i = 0; i < 5; ++i) {
    CalibratedImage image;
    image.id = i;
    image.name = "./image" + std::to_string(i) + ".jpg";
    image.camera_id = 1;
    for (const TiePoint& point : model.points) {
      const Eigen::Vector3d q =
          PosedCamera{model.cameras[1].pinhole, image.rotation_cam_from_world, image.translation_cam_from_world}
              .Project(point.position);
      image.observations.push_back({q.head<2>() + Eigen::Vector2d(0.3, 0), point.id});
    }
    model.images.push_back(std::move(image));
  }
  return model;
}

TEST(TiePoints, ImageWithAnotherPoseIsNamed) {
  CalibratedImages model = ModelWithPoints();
  EXPECT_THAT(MeasureTiePoints(model).stale, IsEmpty());
  EXPECT_NEAR(MeasureTiePoints(model).images_px.at("image1.jpg"), 0.3, 1e-6);
  model.images[3].translation_cam_from_world.x() = 0.8;  // 8 px
  const TiePointFigures figures = MeasureTiePoints(model);
  EXPECT_THAT(figures.stale, ElementsAre("image3.jpg"));
  EXPECT_LT(figures.median_px, 0.4) << "the median of all hides it";
  Faults faults;
  Warnings warnings;
  JudgeTiePoints(SceneDescription(), figures, {}, &faults, &warnings);
  ASSERT_THAT(warnings, SizeIs(1));
  EXPECT_THAT(warnings[0], HasSubstr("the poses of 1 of 5 images do not fit their 3D points"));
  EXPECT_THAT(warnings[0], HasSubstr("image3.jpg ("));
}

TEST(TiePoints, DistanceFromTheMeshIsSigned) {
  TriangleMesh mesh;
  mesh.vertices = {{-100, -100, 4}, {100, -100, 4}, {0, 200, 4}};
  mesh.faces = {{0, 1, 2}};
  TiePointFigures figures = MeasureTiePoints(ModelWithPoints());
  MeasurePointDistances(ModelWithPoints(), SceneDescription(), mesh, &figures);
  ASSERT_TRUE(figures.above_mesh_m.has_value());
  EXPECT_NEAR(*figures.above_mesh_m, 6, 1e-9);
  EXPECT_NEAR(*figures.from_mesh_m, 6, 1e-9);
  Faults faults;
  Warnings warnings;
  JudgeTiePoints(SceneDescription(), figures, {.mesh_fits = true, .gsd_m = 0.1}, &faults, &warnings);
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("6.00 m from the mesh in the median")));
  warnings.clear();
  JudgeTiePoints(SceneDescription(), figures, {.mesh_fits = true, .gsd_m = 1}, &faults, &warnings);
  EXPECT_THAT(warnings, IsEmpty());
}

}  // namespace
}  // namespace tessera
