// Random jobs of small scenes: the result does not depend on the number of tiles, for any settings.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/base/random.h"
#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "common/storage/files.h"
#include "tests/property/line/same_mesh.h"
#include "tests/property/line/strip.h"
#include "tests/support/in_process_line.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

constexpr uint64_t kCases = 24, kFirstSeed = 100;

// Sometimes the limits; otherwise log-uniform.
double RandomReal(const Setting<double>& setting, Random* random) {
  switch (random->Below(6)) {
    case 0:
      return setting.low;
    case 1:
      return setting.high;
    case 2:
      return random->Uniform(setting.low, setting.high);
    default: {
      const double low = std::max(setting.low, 1e-3 * setting.high);
      return std::clamp(low * std::pow(setting.high / low, random->Uniform(0, 1)), setting.low, setting.high);
    }
  }
}

int RandomWhole(int low, int high, Random* random) { return low + static_cast<int>(random->Below(high - low + 1)); }

JobSettings RandomJob(Random* random) {
  JobSettings job;
  job.method = kMethods[random->Below(kMethods.size())];
  job.rounds = RandomWhole(1, 2, random);
  MethodSettings& settings = job.method_settings;
  for (const auto& setting : RealSettings()) {
    if (random->Below(2) == 0) settings.*setting.value = RandomReal(setting, random);
  }
  for (const auto& setting : WholeSettings()) {
    if (random->Below(2) == 0) settings.*setting.value = RandomWhole(setting.low, setting.high, random);
  }
  if (settings.window_px) *settings.window_px |= 1;
  if (random->Below(2) == 0) settings.labels_first = random->Below(2) == 0;
  if (job.method == "baseline") settings.semantic = settings.inter = std::nullopt;
  if (job.method == kLabelsMethod) {
    job.rounds = 0;
    MethodSettings of_labels;
    of_labels.normal_prior = settings.normal_prior;
    of_labels.label_smoothness = settings.label_smoothness;
    of_labels.views_per_direction = settings.views_per_direction;
    settings = of_labels;
    return job;
  }
  // Lists: one or two levels, from coarse to fine, with one or two steps each.
  const ListSetting& levels = ListSettings()[0];
  settings.levels = {RandomWhole(levels.low, levels.high, random)};
  if (settings.levels[0] > levels.low && random->Below(2) == 0) {
    settings.levels.push_back(RandomWhole(levels.low, settings.levels[0] - 1, random));
  }
  for (size_t i = 0; i < settings.levels.size(); ++i) settings.iterations.push_back(RandomWhole(1, 2, random));
  return job;
}

std::string RandomScene(const std::string& folder, Random* random) {
  if (random->Below(4) == 0) {  // enough class borders for border trust, which tiny scenes lack
    SynthesizeStrip(folder, 2);
    return folder;
  }
  using Likelihoods = TinySceneOptions::Likelihoods;
  TinySceneOptions options;
  options.tower = random->Below(3) == 0;
  options.labels = random->Below(3) != 0;
  if (random->Below(3) == 0) options.k1 = -0.05;
  if (random->Below(4) == 0) options.absent_class = true;
  if (random->Below(5) == 0) options.likelihoods = Likelihoods::kNone;
  if (options.likelihoods == Likelihoods::kNone) options.absent_class = false;
  TinyScene scene = WriteTinyScene(folder, options);
  // The start differs from the ground truth, so that vertices move.
  for (Eigen::Vector3d& p : scene.mesh.vertices) p.z() += 0.15 * random->Normal();
  WriteText(folder + "/mesh.ply", AsciiPly(scene.mesh, "double"));
  return folder;
}

TEST(RandomJobs, ResultIsIndependentOfTheTiling) {
  int64_t samples = 0, moved = 0, classified = 0;
  for (uint64_t seed = kFirstSeed; seed < kFirstSeed + kCases; ++seed) {
    Random random(seed);
    const std::string folder = RandomScene(FreshTestFolder("scene"), &random);
    JobSettings job = RandomJob(&random);
    // Sometimes the job computes the likelihoods.
    if (Random(seed + 1000).Below(4) == 0) job.classifier = kDefaultClassifier;
    const bool has_likelihoods = Classifies(job) || LoadScene(folder, nullptr).value().has_likelihoods;
    while (job.method == kLabelsMethod && !has_likelihoods) job = RandomJob(&random);
    classified += Classifies(job);
    const int tiles = RandomWhole(2, 6, &random);
    SCOPED_TRACE(testing::Message() << "seed " << seed << ": " << tiles << " tiles, method " << job.method << ", "
                                    << (Classifies(job) ? "classified, " : "") << job.rounds << " rounds, "
                                    << ToJson(job.method_settings));
    std::string meshes[2];
    for (const bool tiled : {false, true}) {
      job.tiles = tiled ? tiles : 1;
      const auto tasks = RunLine(folder, folder + (tiled ? "/tiled" : "/untiled"), job);
      ASSERT_TRUE(tasks.ok()) << tasks.status();
      meshes[tiled] = tasks->back().output_dir + "/" + kMeshFile;
      const auto report = nlohmann::json::parse(ReadText(tasks->back().output_dir + "/" + kReportFile));
      const auto& seams = report.at("seams");
      EXPECT_EQ(seams.at("different").get<int64_t>(), 0) << seams.dump();
      samples += seams.at("samples").get<int64_t>();
      moved += report.at("displacement").value("max_m", 0.0) > 0;
    }
    EXPECT_TRUE(SameMesh(meshes[0], meshes[1]));
    EXPECT_TRUE(RemoveTree(folder).ok());
  }
  EXPECT_GT(samples, 0);
  EXPECT_GT(classified, 2);
  EXPECT_GT(moved, static_cast<int64_t>(kCases)) << "the test is void: few jobs move vertices";
}

}  // namespace
}  // namespace tessera
