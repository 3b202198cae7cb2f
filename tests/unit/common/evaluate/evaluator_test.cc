#include "common/evaluate/evaluator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "common/base/parallel.h"
#include "common/evaluate/evaluation_report.h"
#include "common/evaluate/label_rendering.h"
#include "tests/unit/common/evaluate/flat_world.h"

namespace tessera {
namespace {

using testing::HasSubstr;

constexpr double kSide = 10;

std::vector<SceneView> ThreeViews() {
  std::vector<SceneView> views;
  for (int i = 0; i < 3; ++i) views.push_back(ViewFromAbove({5.0 + i, 5, 100}, 20, 80, i));
  return views;
}

StatusOr<Evaluator> MakeEvaluator(EvaluationOptions options = {}, std::vector<SceneView> views = ThreeViews()) {
  options.samples = 5000;
  const TriangleMesh truth = FlatSquare(kSide, 4, 0);
  const TruthLabelSource images = [truth, views](size_t view) -> StatusOr<LabelImage> {
    if (view == 2) return LabelImage();  // has none
    return RenderLabels(truth, RayCaster(truth), views[view].camera);
  };
  return Evaluator::Create(truth, views, 2, images, options);
}

TEST(Evaluator, TruthScoresPerfectly) {
  const auto evaluator = MakeEvaluator();
  ASSERT_TRUE(evaluator.ok()) << evaluator.status();
  const auto e = evaluator->Evaluate(FlatSquare(kSide, 7, 0));  // other faces, the same surface
  ASSERT_TRUE(e.ok()) << e.status();
  EXPECT_NEAR(e->surface.accuracy.mean_m, 0, 1e-9);
  EXPECT_NEAR(e->surface.completeness.percentile90_m, 0, 1e-9);
  EXPECT_EQ(e->surface.accuracy.points, 5000);
  EXPECT_DOUBLE_EQ(e->surface.f_scores[0].f, 1);
  EXPECT_NEAR(e->surface.normal_consistency, 1, 1e-12);
  EXPECT_NEAR(e->area_m2, 100, 1e-9);
  const auto same = evaluator->Evaluate(FlatSquare(kSide, 4, 0));
  ASSERT_TRUE(same.ok());
  EXPECT_DOUBLE_EQ(same->labels_by_area->scores.mean_iou, 1);
  EXPECT_DOUBLE_EQ(same->labels_by_pixels->scores.mean_iou, 1);
  EXPECT_DOUBLE_EQ(same->labels_by_pixels->boundary_f, 1);
  EXPECT_EQ(same->labels_by_pixels->views, 2);
}

TEST(Evaluator, OffsetPlaneHasItsOffsetAsDistance) {
  const auto evaluator = MakeEvaluator();
  ASSERT_TRUE(evaluator.ok());
  const auto e = evaluator->Evaluate(FlatSquare(kSide, 4, 0.15));
  ASSERT_TRUE(e.ok());
  for (const DistanceStatistics& s : {e->surface.accuracy, e->surface.completeness}) {
    EXPECT_NEAR(s.mean_m, 0.15, 1e-9);
    EXPECT_NEAR(s.median_m, 0.15, 1e-9);
    EXPECT_NEAR(s.capped_mean_m, 0.15, 1e-9);
  }
  EXPECT_EQ(e->surface.f_scores[1].f, 0);         // at 0.10
  EXPECT_DOUBLE_EQ(e->surface.f_scores[2].f, 1);  // at 0.20
  EXPECT_NEAR(e->surface_by_class[1].accuracy.mean_m, 0.15, 1e-9);
}

TEST(Evaluator, HalfASurfaceIsAccurateButIncomplete) {
  const auto evaluator = MakeEvaluator();
  ASSERT_TRUE(evaluator.ok());
  TriangleMesh half = FlatSquare(kSide, 4, 0);
  for (Eigen::Vector3d& v : half.vertices) v.x() *= 0.5;
  half.labels.assign(half.faces.size(), 0);
  const auto e = evaluator->Evaluate(half);
  ASSERT_TRUE(e.ok());
  EXPECT_NEAR(e->surface.accuracy.mean_m, 0, 1e-9);
  EXPECT_NEAR(e->surface.completeness.mean_m, 0.5 * 2.5, 0.02);
  EXPECT_NEAR(e->surface.f_scores[0].recall, 0.505, 0.01);
  EXPECT_NEAR(e->surface_by_class[0].completeness.mean_m, 0, 1e-9);
  EXPECT_NEAR(e->surface_by_class[1].completeness.mean_m, 2.5, 0.02);
  // Pixels of the missing half have no rendered label and count as wrong.
  EXPECT_NEAR(e->labels_by_pixels->scores.overall_accuracy, 0.5, 0.02);
  EXPECT_GT(e->labels_by_pixels->confusion.at(1, 2), 0);
}

TEST(Evaluator, ExcludesTheRim) {
  EvaluationOptions options;
  options.rim_m = 2;
  const auto evaluator = MakeEvaluator(options);
  ASSERT_TRUE(evaluator.ok());
  TriangleMesh mesh = FlatSquare(kSide, 10, 0);
  for (Eigen::Vector3d& v : mesh.vertices) {
    if (v.x() < 0.5) v.z() = 5;  // wrong, but in the rim alone
  }
  const auto e = evaluator->Evaluate(mesh);
  ASSERT_TRUE(e.ok());
  EXPECT_NEAR(e->surface.accuracy.mean_m, 0, 1e-9);
  EXPECT_NEAR(static_cast<double>(e->surface.completeness.points), 0.36 * 5000, 30);
}

TEST(Evaluator, ExcludesPointsSeenByFewCameras) {
  std::vector<SceneView> views = ThreeViews();
  views[2] = ViewFromAbove({0, 5, 100}, 10, 80, 2);  // sees x < 5
  const auto evaluator = MakeEvaluator({}, views);
  ASSERT_TRUE(evaluator.ok());
  const auto e = evaluator->Evaluate(FlatSquare(kSide, 4, 0));
  ASSERT_TRUE(e.ok());
  EXPECT_NEAR(static_cast<double>(e->surface.accuracy.points), 2500, 60);
  EXPECT_EQ(e->surface_by_class[1].accuracy.points, 0);
  EvaluationOptions options;
  options.min_views = 4;
  const auto none = MakeEvaluator(options);
  EXPECT_EQ(none.status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST(Evaluator, IsTranslationInvariantTo1000Km) {
  EvaluationOptions options;
  options.samples = 2000;
  const Eigen::Vector3d far(1e6, 2e6, 300);
  std::vector<SceneView> views;
  for (int i = 0; i < 3; ++i) {
    views.push_back(ViewFromAbove({5.0 + i, 5, 100}, 20, 80, i));
    PosedCamera& camera = views.back().camera;
    camera.translation_cam_from_world -= camera.rotation_cam_from_world * far;
  }
  const auto evaluator = Evaluator::Create(FlatSquare(kSide, 4, 0, far), views, 2, nullptr, options);
  ASSERT_TRUE(evaluator.ok()) << evaluator.status();
  const auto e = evaluator->Evaluate(FlatSquare(kSide, 4, 0.01, far));
  ASSERT_TRUE(e.ok());
  EXPECT_EQ(e->surface.accuracy.points, 2000);
  EXPECT_NEAR(e->surface.accuracy.mean_m, 0.01, 1e-9);
  EXPECT_FALSE(e->labels_by_pixels.has_value());
}

TEST(Evaluator, GeometryOnlyWithoutLabels) {
  const auto evaluator = MakeEvaluator();
  ASSERT_TRUE(evaluator.ok());
  TriangleMesh mesh = FlatSquare(kSide, 4, 0);
  mesh.labels.clear();
  const auto e = evaluator->Evaluate(mesh);
  ASSERT_TRUE(e.ok());
  EXPECT_FALSE(e->labels_by_area || e->labels_by_pixels);
}

TEST(Evaluator, RejectsInvalidInput) {
  const auto evaluator = MakeEvaluator();
  ASSERT_TRUE(evaluator.ok());
  TriangleMesh mesh = FlatSquare(kSide, 4, 0);
  mesh.labels[3] = 2;
  EXPECT_THAT(std::string(evaluator->Evaluate(mesh).status().message()), HasSubstr("faces[3]"));
  EXPECT_TRUE(absl::IsInvalidArgument(evaluator->Evaluate(TriangleMesh()).status()));
  const TruthLabelSource wrong = [](size_t) -> StatusOr<LabelImage> { return LabelImage(80, 80, 1, 7); };
  const auto with_wrong_images = Evaluator::Create(FlatSquare(kSide, 4, 0), ThreeViews(), 2, wrong, {});
  ASSERT_TRUE(with_wrong_images.ok());
  EXPECT_THAT(std::string(with_wrong_images->Evaluate(FlatSquare(kSide, 4, 0)).status().message()),
              HasSubstr("class 7"));
}

TEST(Evaluator, AnyNumberOfThreadsGivesTheSame) {
  TriangleMesh mesh = FlatSquare(kSide, 9, 0);
  for (size_t v = 0; v < mesh.vertices.size(); ++v) mesh.vertices[v].z() = 0.1 * std::sin(static_cast<double>(v));
  mesh.labels.resize(mesh.faces.size());
  const auto json = [&](int threads) {
    const ThreadLimit limit(threads);
    const auto evaluator = MakeEvaluator();
    return EvaluationJson({{"result", *evaluator->Evaluate(mesh)}}, {"a", "b"}, {});
  };
  EXPECT_EQ(json(1), json(4));
}

TEST(Report, ListsFiguresAndRatio) {
  const auto evaluator = MakeEvaluator();
  ASSERT_TRUE(evaluator.ok());
  const std::vector<NamedEvaluation> both = {{"start", *evaluator->Evaluate(FlatSquare(kSide, 4, 0.2))},
                                             {"result", *evaluator->Evaluate(FlatSquare(kSide, 4, 0.1))}};
  const std::string table = EvaluationTable(both, {"ground", "roof"}, {});
  EXPECT_THAT(table, testing::ContainsRegex("accuracy mean +0.2000 +0.1000 +0.500\n"));
  EXPECT_THAT(table, HasSubstr("F-score at 0.05 m"));
  EXPECT_THAT(table, testing::ContainsRegex("ground +100.00 +0.00 +0.00\n"));
  const std::string json = EvaluationJson(both, {"ground", "roof"}, {});
  EXPECT_THAT(json, HasSubstr("\"average_accuracy\": 1.0"));
}

}  // namespace
}  // namespace tessera
