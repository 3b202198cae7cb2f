// The fit of images, poses and mesh: what each mistake of an export does to it, and what its user is told.
#include "common/check/fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "common/check/fit_findings.h"
#include "common/check/fit_pairs.h"
#include "common/check/patch_match.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// A textured plane z = 0, seen by a camera 20 m above it.
float Texture(double x, double y) {
  double value = 0.5;
  const double wave_m[5] = {0.83, 0.61, 0.43, 0.31, 0.22};
  for (int i = 0; i < 5; ++i) {
    value += 0.08 * std::sin(6.283185307179586 * (x * std::cos(1.0 + i) + y * std::sin(1.0 + i)) / wave_m[i] + i);
  }
  return static_cast<float>(value);
}

PosedCamera CameraAt(const Eigen::Vector3d& centre, double focal_px) {
  PosedCamera camera;
  camera.intrinsics = {240, 180, focal_px, focal_px, 120, 90};
  const Eigen::Vector3d forward = -centre.normalized();
  const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitY()).normalized();
  camera.rotation_cam_from_world.row(0) = right;
  camera.rotation_cam_from_world.row(1) = forward.cross(right);
  camera.rotation_cam_from_world.row(2) = forward;
  camera.translation_cam_from_world = -camera.rotation_cam_from_world * centre;
  return camera;
}

FloatImage PhotographOfPlane(const PosedCamera& camera, double height_m) {
  FloatImage image(camera.intrinsics.width, camera.intrinsics.height);
  const Eigen::Vector3d centre = camera.Centre();
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const Eigen::Vector3d ray = camera.Ray(x + 0.5, y + 0.5);
      const Eigen::Vector3d p = centre + (height_m - centre.z()) / ray.z() * ray;
      image.at(x, y) = Texture(p.x(), p.y());
    }
  }
  return image;
}

class PatchMatchTest : public testing::Test {
 protected:
  PatchMatch Match(const PosedCamera& a, const PosedCamera& b, const SurfacePoint& point) const {
    const std::optional<PatchMatch> match = MatchPatch({&first_, a}, {&second_, b}, point, 1);
    EXPECT_TRUE(match.has_value());
    return match.value_or(PatchMatch());
  }

  const PosedCamera a_ = CameraAt({-4, 0.1, 20}, 400), b_ = CameraAt({5, 1, 20}, 400);
  const FloatImage first_ = PhotographOfPlane(a_, 0), second_ = PhotographOfPlane(b_, 0);
  const SurfacePoint point_ = {{0.5, -0.4, 0}, {0, 0, 1}};
};

TEST_F(PatchMatchTest, TrueSceneMatchesInPlace) {
  const PatchMatch match = Match(a_, b_, point_);
  EXPECT_GT(match.correlation, 0.98);
  EXPECT_TRUE(match.distinct);
  EXPECT_LT(match.shift_px.norm(), 0.15);
  for (const float value : match.at_random) EXPECT_LT(value, 0.95);
}

TEST_F(PatchMatchTest, ShiftsFollowTheirDerivatives) {
  SurfacePoint lower = point_;
  lower.position.z() -= 0.3;
  const PatchMatch match = Match(a_, b_, lower);
  ASSERT_TRUE(match.distinct);
  EXPECT_GT(match.shift_px.norm(), 1.5);
  EXPECT_LT((match.shift_px - 0.3 * match.by_surface).norm(), 0.25) << match.shift_px.transpose();
  EXPECT_GT(std::abs(match.shift_px.normalized().dot(match.epipolar_dir)), 0.99);

  PosedCamera longer = b_;
  longer.intrinsics.fx *= 1.02, longer.intrinsics.fy *= 1.02;
  SurfacePoint aside = point_;
  aside.position += Eigen::Vector3d(2, 2, 0);
  const PatchMatch of_focal = Match(a_, longer, aside);
  ASSERT_TRUE(of_focal.distinct);
  EXPECT_GT(of_focal.shift_px.norm(), 0.5);
  EXPECT_LT((of_focal.shift_px + 0.02 * of_focal.by_other_focal).norm(), 0.2) << of_focal.shift_px.transpose();
}

TEST_F(PatchMatchTest, CorrelationsAloneAreThoseOfTheMatch) {
  for (int i = 0; i < 6; ++i) {
    SurfacePoint point = point_;
    point.position += Eigen::Vector3d(0.3 * i, 0.2 * i, -0.1 * i);
    const PatchMatch match = Match(a_, b_, point);
    const auto found = CorrelateAtRandom({&first_, a_}, {&second_, b_}, point, 1);
    ASSERT_TRUE(found.has_value());
    EXPECT_NEAR(found->correlation, match.correlation, 1e-5);
    EXPECT_EQ(found->at_random, match.at_random);
    EXPECT_EQ(CorrelatePatch({&first_, a_}, {&second_, b_}, point), found->correlation);
  }
  EXPECT_FALSE(CorrelateAtRandom({&first_, a_}, {&second_, b_}, {{30, 0, 0}, {0, 0, 1}}, 1));
}

TEST_F(PatchMatchTest, NoneWithoutTextureOrOutsideTheImage) {
  FloatImage grey(240, 180);
  std::fill(grey.data.begin(), grey.data.end(), 0.5f);
  EXPECT_FALSE(MatchPatch({&grey, a_}, {&second_, b_}, point_, 1));
  EXPECT_FALSE(MatchPatch({&first_, a_}, {&second_, b_}, {{30, 0, 0}, {0, 0, 1}}, 1));
}

class FitTest : public testing::Test {
 protected:
  void SetUp() override {
    TinySceneOptions options;
    options.tower = true;
    const std::string folder = FreshTestFolder("fit");
    WriteTinyScene(folder, options);
    scene_ = *LoadScene(folder, &warnings_);
    mesh_ = *LoadSceneMesh(scene_, 0);
    gsd_m_ = *MedianGsd(scene_, mesh_);
  }

  SceneFit Measure() const {
    const StatusOr<SceneFit> fit = MeasureFit(scene_, mesh_, {}, {});
    EXPECT_TRUE(fit.ok()) << fit.status();
    return fit.ok() ? *fit : SceneFit();
  }
  // What the user is told of the fit.
  std::string Told(const SceneFit& fit) {
    const Reading reading = *FindReading(scene_, mesh_, fit, gsd_m_, SearchFor(fit, gsd_m_, true), {});
    Warnings warnings;
    const Status status = JudgeFit(scene_, fit, reading, gsd_m_, &warnings);
    std::string text(status.message());
    for (const std::string& warning : warnings) text += "\n" + warning;
    return text;
  }
  void Turn(size_t view, double by_px, const Eigen::Vector3d& axis = {0.8, -0.6, 0}) {
    PosedCamera& camera = scene_.views[view].camera;
    const Eigen::Vector3d centre = camera.Centre();
    camera.rotation_cam_from_world =
        Eigen::AngleAxisd(by_px / camera.intrinsics.fx, axis).toRotationMatrix() * camera.rotation_cam_from_world;
    camera.translation_cam_from_world = -camera.rotation_cam_from_world * centre;
  }

  Warnings warnings_;
  SceneDescription scene_;
  TriangleMesh mesh_;
  double gsd_m_ = 0;
};

TEST_F(FitTest, GoodSceneIsNotWarnedOf) {
  const SceneFit fit = Measure();
  EXPECT_GT(fit.all.pairs, 10);
  EXPECT_GT(fit.all.above_chance, 0.8);
  EXPECT_LT(fit.all.across_px, 0.2);
  EXPECT_LT(fit.pose_error_px, 0.06);
  EXPECT_EQ(Told(fit), "");
  for (const double change : fit.focal_changes) EXPECT_LT(std::abs(change), 0.002);
}

TEST_F(FitTest, ViewWithAWrongPoseIsNamed) {
  for (const double error_px : {1.5, 3.0, 20.0}) {
    const SceneDescription good = scene_;
    Turn(2, error_px);
    const SceneFit fit = Measure();
    EXPECT_THAT(fit.misplaced, ElementsAre(2)) << error_px;
    EXPECT_THAT(Told(fit), HasSubstr(scene_.views[2].name)) << error_px;
    scene_ = good;
  }
}

// Where an error is along the epipolar lines of two views, it does not show across them, in neither of their pairs.
TEST_F(FitTest, WrongPoseIsNamedThoughItDoesNotShowWithOnePartner) {
  ASSERT_GE(scene_.views.size(), 6u);
  std::vector<FitMatches> pairs;
  for (int a = 0; a < 6; ++a) {
    for (int b = 0; b < 6; ++b) {
      if (a == b || (a == 0 && b > 1 && b < 4)) continue;  // 8 pairs of view 0, 2 of which with view 1
      FitMatches& pair = pairs.emplace_back(FitMatches{a, b, 1, {}});
      const bool wrong = (a == 0 || b == 0) && a != 1 && b != 1;
      for (int i = 0; i < 20; ++i) {
        PatchMatch match;
        match.correlation = 0.9;
        match.at_random.assign(6, 0.1f);
        match.distinct = true;
        match.shift_px = {0.1, (wrong ? 3 : 0) + 0.01 * (i + a + b)};
        pair.matches.push_back({SurfacePoint{{0, 0, 0}, {0, 0, 1}}, match});
      }
    }
  }
  EXPECT_THAT(SumUpFit(scene_, pairs).misplaced, ElementsAre(0));
}

TEST_F(FitTest, SmallErrorsOfAllPosesAreToldOf) {
  const SceneDescription good = scene_;
  for (const double error_px : {0.5, 0.9}) {
    for (size_t v = 0; v < scene_.views.size(); ++v) {
      const double angle = 2.4 * static_cast<double>(v);  // golden angle: all directions
      Turn(v, error_px, {std::cos(angle), std::sin(angle), 0});
    }
    const SceneFit fit = Measure();
    EXPECT_NEAR(fit.pose_error_px, error_px, 0.4 * error_px);
    EXPECT_THAT(Told(fit), HasSubstr("poses are wrong by about"));
    scene_ = good;
  }
}

// A mesh that is turned about the vertical, or mirrored: its ground matches, too.
TEST_F(FitTest, MapOfTheMeshThatKeepsUpIsNamed) {
  const TriangleMesh good = mesh_;
  for (Eigen::Vector3d& p : mesh_.vertices) {
    const Eigen::Vector3d q = scene_.frame.SceneFromLocal(p);
    p = scene_.frame.LocalFromScene({-q.x(), -q.y(), q.z()});
  }
  EXPECT_THAT(Told(Measure()), HasSubstr("to (-x, -y, z)"));
  mesh_ = good;
  for (Eigen::Vector3d& p : mesh_.vertices) {
    const Eigen::Vector3d q = scene_.frame.SceneFromLocal(p);
    p = scene_.frame.LocalFromScene({q.y(), q.x(), q.z()});
  }
  for (auto& face : mesh_.faces) std::swap(face[0], face[1]);
  EXPECT_THAT(Told(Measure()), HasSubstr("to (y, x, z)"));
}

TEST_F(FitTest, WrongFocalLengthIsMeasured) {
  for (SceneView& view : scene_.views) view.camera.intrinsics.fx *= 1.01, view.camera.intrinsics.fy *= 1.01;
  const SceneFit fit = Measure();
  for (const double change : fit.focal_changes) EXPECT_NEAR(change, -0.0099, 0.002);
  EXPECT_THAT(Told(fit), HasSubstr("focal length"));
}

TEST_F(FitTest, ShiftOfTheMeshIsMeasured) {
  for (Eigen::Vector3d& p : mesh_.vertices) p.z() += 0.6;
  const SceneFit fit = Measure();
  EXPECT_NEAR(fit.mesh_shift_m.z(), -0.6, 0.2);
  EXPECT_THAT(Told(fit), HasSubstr("if it were moved by"));
}

TEST_F(FitTest, ReadingOfAWholeSceneIsNamed) {
  const TriangleMesh good = mesh_;
  for (Eigen::Vector3d& p : mesh_.vertices) {
    p = scene_.frame.LocalFromScene(scene_.frame.SceneFromLocal(p) / 0.3048);
  }
  EXPECT_THAT(Told(Measure()), HasSubstr("feet"));
  mesh_ = good;
  for (Eigen::Vector3d& p : mesh_.vertices) {
    const Eigen::Vector3d q = scene_.frame.SceneFromLocal(p);
    p = scene_.frame.LocalFromScene({q.x(), q.z(), -q.y()});
  }
  EXPECT_THAT(Told(Measure()), HasSubstr("y is up in the mesh"));
  mesh_ = good;
  for (SceneView& view : scene_.views) view.camera.intrinsics.cx = view.camera.intrinsics.cy = 0;
  EXPECT_THAT(Told(Measure()), HasSubstr("principal point"));
}

TEST_F(FitTest, SceneOfOneImageIsNotMeasured) {
  scene_.views.resize(1);
  const SceneFit fit = Measure();
  EXPECT_EQ(fit.all.pairs, 0);
  EXPECT_THAT(fit.misplaced, IsEmpty());
}

}  // namespace
}  // namespace tessera
