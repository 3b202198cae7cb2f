// What a job makes of the scenes of public reports whose result must be right.
#include <gtest/gtest.h>

#include <filesystem>
#include <optional>

#include "common/evaluate/evaluator.h"
#include "common/meshio/ply.h"
#include "common/scene/scene.h"
#include "tests/support/bent_scene/bent_scene.h"
#include "tests/support/in_process_line.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

struct ResultScores {
  double accuracy_m = 0;  // mean distance of the mesh from the truth
  double labels = 0;      // share of the truth's surface whose label is right
};

// Of a mesh in the base scene's coordinates.
ResultScores ScoresOf(const std::string& mesh_path) {
  const std::string truth_path = bent::BaseScene() + "/truth/mesh.ply";
  static std::optional<Evaluator> evaluator;
  static std::optional<SceneDescription> base;
  const auto read = [](const std::string& path) {
    auto content = ReadPly(path);
    EXPECT_TRUE(content.ok()) << content.status();
    for (Eigen::Vector3d& p : content->mesh.vertices) p = base->frame.LocalFromScene(p);
    return std::move(content->mesh);
  };
  if (!evaluator.has_value()) {
    Warnings warnings;
    base = *LoadScene(bent::BaseScene(), &warnings);
    EvaluationOptions options;
    options.samples = 10000;
    options.rim_m = 9;  // 30 GSD
    const TruthLabelSource no_images = [](size_t) -> StatusOr<LabelImage> { return LabelImage(); };
    evaluator = *Evaluator::Create(read(truth_path), base->views, 4, no_images, options);
  }
  const auto evaluation = evaluator->Evaluate(read(mesh_path));
  EXPECT_TRUE(evaluation.ok()) << evaluation.status();
  const bool has_labels = evaluation.ok() && evaluation->labels_by_area.has_value();
  return {evaluation->surface.accuracy.mean_m, has_labels ? evaluation->labels_by_area->scores.overall_accuracy : 0};
}

// The result of a short job on the scene; none if the scene is refused.
std::optional<ResultScores> RunOf(const std::string& scene) {
  JobSettings settings = {.tiles = 1, .rounds = 1};
  settings.method_settings.levels = {1, 0};
  settings.method_settings.iterations = {6, 4};
  const auto tasks = RunLine(scene, scene + "/work", settings);
  EXPECT_TRUE(tasks.ok()) << tasks.status();
  if (!tasks.ok()) return std::nullopt;
  return ScoresOf(tasks->back().output_dir + "/mesh.ply");
}

// The result of the base scene.
const ResultScores& BaseResult() {
  static const ResultScores result = [] {
    const std::string scene = FreshTestFolder("base") + "/scene";
    bent::CopyBaseScene(scene);
    return RunOf(scene).value_or(ResultScores());
  }();
  return result;
}

struct RunCase {
  const char* name;
  void (*bend)(const std::string& scene);
  double accuracy = 1.1;  // at most, times that of the base's result
  double labels = -0.01;  // at least, plus that of the base's result
};

class RunOfReports : public testing::TestWithParam<RunCase> {};

TEST_P(RunOfReports, IsAsGoodAsThatOfTheBaseScene) {
  const RunCase& report = GetParam();
  const std::string scene = FreshTestFolder("bent") + "/scene";
  bent::CopyBaseScene(scene);
  report.bend(scene);
  const std::optional<ResultScores> result = RunOf(scene);
  ASSERT_TRUE(result.has_value());
  EXPECT_LT(result->accuracy_m, report.accuracy * BaseResult().accuracy_m);
  EXPECT_GT(result->labels, report.labels + BaseResult().labels);
  fs::remove_all(scene);
}

// Of the other scenes that are accepted, check_reports_test shows that a job reads the same as of a good scene.
INSTANTIATE_TEST_SUITE_P(
    All, RunOfReports,
    testing::Values(RunCase{"12_bits_in_16", bent::Tiff16Bit12}, RunCase{"masks", bent::TransparentMasks, 1.3, -0.03},
                    RunCase{"triangle_soup", bent::TriangleSoup}, RunCase{"tile_borders", bent::TileBorders},
                    RunCase{"inside_out", bent::InsideOut}, RunCase{"floating_bits", bent::FloatingBits, 1.3},
                    RunCase{"spike", bent::SpikeOfAKilometre}, RunCase{"other_start_labels", bent::SumLabels}),
    [](const auto& report) { return std::string(report.param.name); });

TEST(RunOfBaseScene, IsBetterThanItsStart) {
  const ResultScores start = ScoresOf(bent::BaseScene() + "/mesh.ply");
  EXPECT_LT(BaseResult().accuracy_m, 0.7 * start.accuracy_m);
  EXPECT_GT(BaseResult().labels, start.labels + 0.03);
}

// Likelihoods that say nothing leave the labels of the start.
TEST(RunOfAllZeroFiles, KeepsTheLabelsOfTheStart) {
  const std::string scene = FreshTestFolder("zero") + "/scene";
  bent::CopyBaseScene(scene);
  bent::AllZeroFiles(scene);
  const std::optional<ResultScores> result = RunOf(scene);
  ASSERT_TRUE(result.has_value());
  EXPECT_GT(result->labels, ScoresOf(bent::BaseScene() + "/mesh.ply").labels - 0.01);
}

}  // namespace
}  // namespace tessera
