// `tessera classify`: from four annotated images to likelihoods and a labelled mesh.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "common/meshio/ply.h"
#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

class ClassifyTest : public testing::Test {
 protected:
  ClassifyTest() : folder_(TempFolder::Create(testing::TempDir()).value()), painted_(folder_.path() + "/painted") {
    fs::create_directory(painted_);
    std::vector<fs::path> truths;
    for (const auto& entry : fs::directory_iterator(ToyCity() + "/truth")) {
      if (entry.path().filename().string().ends_with("_label.png")) truths.push_back(entry.path());
    }
    std::sort(truths.begin(), truths.end());
    for (size_t k = 0; k < 4; ++k) {
      const fs::path& truth = truths[k * truths.size() / 4];
      fs::copy_file(truth, fs::path(painted_) / truth.filename());
      const std::string name = truth.filename().string();
      if (k > 0) except_.push_back(',');
      except_.append(name, 0, name.size() - std::string("_label.png").size());
    }
  }
  Outcome Run(const std::vector<std::string>& arguments) { return Tessera(folder_.path(), arguments); }
  double OverallAccuracy(const std::string& likelihoods) {
    const std::string json = folder_.path() + "/scores.json";
    const Outcome outcome = Run(
        {"evaluate", "--likelihoods", likelihoods, "--scene", ToyCity(), "--except-views", except_, "--json", json});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    return nlohmann::json::parse(Content(json))["all"]["overall_accuracy"];
  }

  // Of a mesh's labels, where it and the start have a surface.
  double MeshAccuracy(const std::string& mesh, const std::string& likelihoods) {
    const std::string json = folder_.path() + "/beside.json";
    const Outcome outcome = Run({"evaluate", mesh, "--likelihoods", likelihoods, "--scene", ToyCity(), "--except-views",
                                 except_, "--json", json});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    EXPECT_THAT(outcome.output, HasSubstr("all: the mesh's labels there"));
    const auto figures = nlohmann::json::parse(Content(json));
    EXPECT_EQ(figures["mesh"]["pixels"], figures["all"]["pixels"]) << "over the same pixels";
    return figures["mesh"]["overall_accuracy"];
  }

  TempFolder folder_;
  const std::string painted_;
  std::string except_;  // the painted images
};

TEST_F(ClassifyTest, FourAnnotatedImagesGiveALabelledMesh) {
  const std::string out = folder_.path() + "/classified", model = folder_.path() + "/city.model";
  const Outcome classified = Run({"classify", ToyCity(), "--train", painted_, "--out", out, "--save-model", model});
  ASSERT_EQ(classified.exit_code, 0) << classified.output;
  EXPECT_THAT(classified.output, HasSubstr("cross-validation       spatial"));
  EXPECT_THAT(classified.output, HasSubstr("annotate next"));
  const auto report = nlohmann::json::parse(Content(out + "/report.json"));
  EXPECT_EQ(report["source"], "annotations");
  EXPECT_EQ(report["annotated"].size(), 4u);
  EXPECT_GT(OverallAccuracy(out + "/geometry"), 0.8);

  const Outcome run = Run({"run", out, "--out", folder_.path() + "/out", "--rounds", "1", "--levels", "1",
                           "--iterations", "2", "--tiles", "1"});
  ASSERT_EQ(run.exit_code, 0) << run.output;
  EXPECT_GT(fs::file_size(folder_.path() + "/out/mesh.ply"), 1000u);

  // Seen on the refined shape, which stays.
  const std::string refined = folder_.path() + "/refined", mesh = folder_.path() + "/out/mesh.ply",
                    labelled = folder_.path() + "/labelled";
  const Outcome seen = Run({"classify", ToyCity(), "--train", painted_, "--mesh", mesh, "--out", refined});
  ASSERT_EQ(seen.exit_code, 0) << seen.output;
  EXPECT_EQ(fs::canonical(refined + "/mesh.ply"), fs::canonical(mesh));
  const Outcome labels = Run({"run", refined, "--out", labelled, "--method", "labels", "--tiles", "2"});
  ASSERT_EQ(labels.exit_code, 0) << labels.output;
  const double before = MeshAccuracy(mesh, out + "/geometry"),
               after = MeshAccuracy(labelled + "/mesh.ply", out + "/geometry");
  EXPECT_GT(before, 0.8);
  EXPECT_GT(after, before - 0.02) << "truer features, though the toy's four iterations make no truer shape";

  const std::string again = folder_.path() + "/again";
  const Outcome by_model = Run({"classify", ToyCity(), "--model", model, "--out", again});
  ASSERT_EQ(by_model.exit_code, 0) << by_model.output;
  EXPECT_GT(OverallAccuracy(again + "/geometry"), 0.8);
}

TEST_F(ClassifyTest, DefaultRuleIsMarkedInTheScene) {
  const std::string out = folder_.path() + "/guessed";
  const Outcome outcome = Run({"classify", ToyCity(), "--out", out});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("default rule (mesh and greenness)"));
  EXPECT_THAT(Content(out + "/scene.json"), HasSubstr("\"likelihoods_source\": \"default\""));
  EXPECT_THAT(Run({"check", out}).output, HasSubstr("likelihoods come from the default rule"));
}

// The job computes the likelihoods with a given model, on workers without shared storage.
TEST_F(ClassifyTest, JobComputesLikelihoods) {
  const std::string model = folder_.path() + "/city.model", out = folder_.path() + "/out";
  ASSERT_EQ(
      Run({"classify", ToyCity(), "--train", painted_, "--out", folder_.path() + "/classified", "--save-model", model})
          .exit_code,
      0);
  const std::vector<std::string> few = {"--rounds", "1", "--levels", "1", "--iterations", "2", "--tiles", "2"};
  const auto run = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "run");
    arguments.insert(arguments.end(), few.begin(), few.end());
    return Run(arguments);
  };
  Outcome outcome = run({ToyCity(), "--classifier", model, "--no-shared-storage", "--out", out});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("seams: 0 of"));
  EXPECT_THAT(outcome.output, HasSubstr("warning: likelihoods: not used, because the job computes likelihoods from the images"));
  const auto job = nlohmann::json::parse(Content(out + "/job.json"));
  EXPECT_EQ(job["settings"]["classifier"], model);
  int classified = 0;
  for (const auto& task : job.at("tasks")) classified += task.at("kind") == "classify";
  EXPECT_GT(classified, 4);
  EXPECT_GT(MeshAccuracy(out + "/mesh.ply", folder_.path() + "/classified/geometry"), 0.8);

  // An update takes the classifier over; where nothing changed, nothing is done.
  fs::remove(model);
  outcome = Run({"run", ToyCity(), "--base", out, "--out", folder_.path() + "/same"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_EQ(Content(folder_.path() + "/same/mesh.ply"), Content(out + "/mesh.ply"));

  outcome = run({ToyCity(), "--classifier", model, "--out", folder_.path() + "/none"});
  EXPECT_EQ(outcome.exit_code, 3) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("city.model"));
  outcome = run({ToyCity(), "--classifier", ToyCity() + "/mesh.ply", "--out", folder_.path() + "/none"});
  EXPECT_EQ(outcome.exit_code, 3) << outcome.output;
  EXPECT_FALSE(fs::exists(folder_.path() + "/none"));
}

TEST_F(ClassifyTest, UnlabelledMeshGetsLabelsFromImages) {
  const std::string bare = folder_.path() + "/bare", out = folder_.path() + "/out";
  fs::create_directory(bare);
  for (const char* part : {"colmap", "images"}) fs::create_directory_symlink(ToyCity() + "/" + part, bare + "/" + part);
  auto mesh = ReadPly(ToyCity() + "/mesh.ply");
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  mesh->mesh.labels.clear();
  ASSERT_TRUE(WritePly(bare + "/mesh.ply", mesh->mesh).ok());
  std::ofstream(bare + "/scene.json") << R"({"tessera_scene": 1})";
  const Outcome outcome =
      Run({"run", bare, "--out", out, "--rounds", "1", "--levels", "1", "--iterations", "2", "--tiles", "1"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_EQ(nlohmann::json::parse(Content(out + "/job.json"))["settings"]["classifier"], "default");
  EXPECT_THAT(outcome.output, HasSubstr("likelihoods come from the default rule"));
  EXPECT_THAT(Content(out + "/report.json"), HasSubstr("likelihoods come from the default rule"));
  const auto result = ReadPly(out + "/mesh.ply");
  ASSERT_TRUE(result.ok()) << result.status();
  const auto& labels = result->mesh.labels;
  EXPECT_EQ(std::set<int32_t>(labels.begin(), labels.end()), (std::set<int32_t>{0, 1, 2, 3}));

  const Outcome plain = Run({"run", bare, "--out", folder_.path() + "/plain", "--classifier", "none", "--rounds", "1",
                             "--levels", "1", "--iterations", "1", "--tiles", "1"});
  ASSERT_EQ(plain.exit_code, 0) << plain.output;
  EXPECT_THAT(Content(folder_.path() + "/plain/report.json"), Not(HasSubstr("come from the default rule")));
}

TEST_F(ClassifyTest, BadInputIsReported) {
  const std::string out = folder_.path() + "/out";
  Outcome outcome = Run({"classify", ToyCity(), "--train", folder_.path() + "/none", "--out", out});
  EXPECT_EQ(outcome.exit_code, 3);
  EXPECT_THAT(outcome.output, HasSubstr("no such folder, expected a folder of annotations"));
  outcome = Run({"classify", ToyCity(), "--model", ToyCity() + "/mesh.ply", "--out", out});
  EXPECT_EQ(outcome.exit_code, 3) << outcome.output;
  outcome = Run({"classify", ToyCity(), "--out", painted_});
  EXPECT_EQ(outcome.exit_code, 2) << "a folder with something else in it is left alone";
  EXPECT_FALSE(fs::exists(out));
  outcome = Run({"evaluate", "--likelihoods", out, "--scene", ToyCity(), "--except-views", "nobody"});
  EXPECT_EQ(outcome.exit_code, 3);
  EXPECT_THAT(outcome.output, HasSubstr("found nobody, expected names of images of the scene"));
}

}  // namespace
}  // namespace tessera::e2e
