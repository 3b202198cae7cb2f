#include "common/importing/proof/patch_proof.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "common/scene/scene.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class PatchProofTest : public testing::Test {
 protected:
  void SetUp() override {
    TinySceneOptions options;
    options.tower = true;
    const std::string folder = FreshTestFolder("patches");
    WriteTinyScene(folder, options);
    Warnings warnings;
    scene_ = *LoadScene(folder, &warnings);
    mesh_ = *LoadSceneMesh(scene_, 0);
  }
  PatchProof Prove() const {
    const StatusOr<SceneFit> fit = MeasureFit(scene_, mesh_, {}, {});
    EXPECT_TRUE(fit.ok()) << fit.status();
    return fit.ok() ? ProveByPatches(*fit) : PatchProof();
  }
  // Turns each second camera by `by_px` about an axis in the image, and the others the other way.
  void TurnCameras(double by_px) {
    for (size_t v = 0; v < scene_.views.size(); ++v) {
      PosedCamera& camera = scene_.views[v].camera;
      const Eigen::Vector3d centre = camera.Centre();
      const double angle = (v % 2 == 0 ? by_px : -by_px) / camera.intrinsics.fx;
      camera.rotation_cam_from_world =
          Eigen::AngleAxisd(angle, Eigen::Vector3d(0.8, -0.6, 0)).toRotationMatrix() * camera.rotation_cam_from_world;
      camera.translation_cam_from_world = -camera.rotation_cam_from_world * centre;
    }
  }

  SceneDescription scene_;
  TriangleMesh mesh_;
};

TEST_F(PatchProofTest, GoodSceneIsProven) {
  const PatchProof proof = Prove();
  EXPECT_TRUE(proof.is_proven) << PatchProofToText(proof);
  EXPECT_GE(proof.pairs, 10);
  EXPECT_LT(proof.median_px, 0.2);
  Warnings warnings;
  EXPECT_TRUE(JudgePatchProof("block.xml", proof, 1.5, &warnings).ok());
  EXPECT_THAT(warnings, IsEmpty());
  EXPECT_THAT(PatchProofToText(proof), HasSubstr("proven: "));
  EXPECT_THAT(PatchProofToJson(proof), HasSubstr("\"proven\": true"));
}

// It moves patches along the epipolar lines only.
TEST_F(PatchProofTest, CoarseMeshDoesNotCount) {
  for (Eigen::Vector3d& p : mesh_.vertices) p.z() += 0.5;  // 2.5 GSD
  EXPECT_TRUE(Prove().is_proven) << PatchProofToText(Prove());
}

TEST_F(PatchProofTest, WrongPosesAreWarnedOf) {
  TurnCameras(0.9);
  const PatchProof proof = Prove();
  EXPECT_FALSE(proof.is_proven);
  Warnings warnings;
  EXPECT_TRUE(JudgePatchProof("block.xml", proof, 1.5, &warnings).ok());
  EXPECT_THAT(warnings, ElementsAre(AllOf(HasSubstr("block.xml: not proven: "), HasSubstr("pairs of images"))));
}

TEST_F(PatchProofTest, VeryWrongPosesAreRefused) {
  TurnCameras(4);
  Warnings warnings;
  const Status status = JudgePatchProof("block.xml", Prove(), 1.5, &warnings);
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("expected at most 1.5 px (--max-error-px)"));
}

TEST(PatchProofFiguresTest, FewOrBadPairsProveNothing) {
  EXPECT_EQ(PatchProofToText(ProveByPatches({})), "not proven: no pairs of images with patches that match");
  SceneFit fit;
  const auto with = [&](int good, int bad, int unmeasured) {
    fit.pairs.clear();
    for (const auto& [count, across_px] : {std::pair(good, 0.5), std::pair(bad, 0.51), std::pair(unmeasured, -1.0)}) {
      fit.pairs.insert(fit.pairs.end(), static_cast<size_t>(count), {0, 1, {1, 200, 0.5, across_px, across_px}});
    }
    return ProveByPatches(fit);
  };
  EXPECT_TRUE(with(9, 1, 0).is_proven);
  EXPECT_EQ(with(9, 1, 3).measured, 10);
  EXPECT_FALSE(with(8, 1, 0).is_proven);
  EXPECT_TRUE(with(5, 0, 5).is_proven);
  EXPECT_FALSE(with(5, 0, 6).is_proven);
  EXPECT_FALSE(with(4, 0, 0).is_proven);
}

}  // namespace
}  // namespace tessera
