// What a job makes of the scenes of public reports whose result must be right.
#include <gtest/gtest.h>

#include <filesystem>
#include <ostream>

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

StatusOr<TriangleMesh> MeshInLocalFrame(const std::string& path, const SceneDescription& scene) {
  TESSERA_ASSIGN_OR_RETURN(MeshContent content, ReadPly(path));
  for (Eigen::Vector3d& p : content.mesh.vertices) p = scene.frame.LocalFromScene(p);
  return std::move(content.mesh);
}

StatusOr<Evaluator> EvaluatorOfBase(const SceneDescription& base) {
  TESSERA_ASSIGN_OR_RETURN(TriangleMesh truth, MeshInLocalFrame(bent::BaseScene() + "/truth/mesh.ply", base));
  EvaluationOptions options;
  options.samples = 10000;
  options.rim_m = 9;  // 30 GSD
  const TruthLabelSource no_images = [](size_t) -> StatusOr<LabelImage> { return LabelImage(); };
  return Evaluator::Create(std::move(truth), base.views, 4, no_images, options);
}

// Of a mesh in the base scene's coordinates.
StatusOr<ResultScores> ScoresOf(const std::string& mesh_path) {
  static Warnings warnings;
  static const StatusOr<SceneDescription> base = LoadScene(bent::BaseScene(), &warnings);
  TESSERA_RETURN_IF_ERROR(base.status());
  static const StatusOr<Evaluator> evaluator = EvaluatorOfBase(*base);
  TESSERA_RETURN_IF_ERROR(evaluator.status());
  TESSERA_ASSIGN_OR_RETURN(const TriangleMesh mesh, MeshInLocalFrame(mesh_path, *base));
  TESSERA_ASSIGN_OR_RETURN(const Evaluation evaluation, evaluator->Evaluate(mesh));
  const bool has_labels = evaluation.labels_by_area.has_value();
  return ResultScores{evaluation.surface.accuracy.mean_m,
                      has_labels ? evaluation.labels_by_area->scores.overall_accuracy : 0};
}

// The result of a short job on the scene.
StatusOr<ResultScores> RunOf(const std::string& scene) {
  JobSettings settings = {.tiles = 1, .rounds = 1};
  settings.method_settings.levels = {1, 0};
  settings.method_settings.iterations = {6, 4};
  TESSERA_ASSIGN_OR_RETURN(const std::vector<LineTask> tasks, RunLine(scene, scene + "/work", settings));
  return ScoresOf(tasks.back().output_dir + "/mesh.ply");
}

const ResultScores& BaseResult() {
  static const ResultScores result = [] {
    const std::string scene = FreshTestFolder("base") + "/scene";
    bent::CopyBaseScene(scene);
    const StatusOr<ResultScores> scores = RunOf(scene);
    EXPECT_TRUE(scores.ok()) << scores.status();
    return scores.ok() ? *scores : ResultScores();
  }();
  return result;
}

const ResultScores& BaseStart() {
  static const ResultScores start = [] {
    const StatusOr<ResultScores> scores = ScoresOf(bent::BaseScene() + "/mesh.ply");
    EXPECT_TRUE(scores.ok()) << scores.status();
    return scores.ok() ? *scores : ResultScores();
  }();
  return start;
}

struct RunCase {
  const char* name;
  void (*bend)(const std::string& scene);
  double accuracy = 1.1;  // at most, times that of the base's result
  double labels = -0.01;  // at least, plus that of the base's result
};

void PrintTo(const RunCase& report, std::ostream* out) { *out << report.name; }

class RunOfReports : public testing::TestWithParam<RunCase> {};

TEST_P(RunOfReports, IsAsGoodAsThatOfTheBaseScene) {
  const RunCase& report = GetParam();
  const std::string scene = FreshTestFolder("bent") + "/scene";
  bent::CopyBaseScene(scene);
  report.bend(scene);
  const StatusOr<ResultScores> result = RunOf(scene);
  ASSERT_TRUE(result.ok()) << result.status().message();
  EXPECT_LT(result->accuracy_m, report.accuracy * BaseResult().accuracy_m);
  EXPECT_GT(result->labels, report.labels + BaseResult().labels);
  fs::remove_all(scene);
}

// Of the other scenes that are accepted, check_reports_test shows that a job reads the same as of a good scene.
// clang-format off
INSTANTIATE_TEST_SUITE_P(
    All, RunOfReports,
    testing::Values(
        RunCase{"12_bits_in_16", bent::Tiff16Bit12},
        RunCase{"masks", bent::TransparentMasks, 1.3, -0.03},
        RunCase{"triangle_soup", bent::TriangleSoup},
        RunCase{"tile_borders", bent::TileBorders},  
        RunCase{"inside_out", bent::InsideOut},      
        RunCase{"spike", bent::SpikeOfAKilometre},   
        RunCase{"other_start_labels", bent::SumLabels}),
    [](const auto& report) { return std::string(report.param.name); });
// clang-format on

TEST(RunOfBaseScene, IsBetterThanItsStart) {
  EXPECT_LT(BaseResult().accuracy_m, 0.7 * BaseStart().accuracy_m);
  EXPECT_GT(BaseResult().labels, BaseStart().labels + 0.03);
}

// Likelihoods that say nothing leave the labels of the start.
TEST(RunOfAllZeroFiles, KeepsTheLabelsOfTheStart) {
  const std::string scene = FreshTestFolder("zero") + "/scene";
  bent::CopyBaseScene(scene);
  bent::AllZeroFiles(scene);
  const StatusOr<ResultScores> result = RunOf(scene);
  ASSERT_TRUE(result.ok()) << result.status().message();
  EXPECT_GT(result->labels, BaseStart().labels - 0.01);
}

}  // namespace
}  // namespace tessera
