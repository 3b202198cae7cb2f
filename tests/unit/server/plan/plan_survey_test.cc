// Tasks that make the survey.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "common/job/task_parameters.h"
#include "server/plan/graph.h"

namespace tessera {
namespace {

TEST(PlanSurvey, IngestReadsTheWholeSceneAndNothingElse) {
  JobSettings one, other, more_pairs, fewer_views, one_split;
  one.tiles = 1;
  other.tiles = 9;
  other.rounds = 3;
  one_split.method = "paper";
  other.method_settings.window_px = 9;
  more_pairs.method_settings.partners = 6;
  fewer_views.method_settings.views_per_direction = 3;
  const auto a = PlanIngest(one, {"images/a.jpg", "scene.json"});
  const auto b = PlanIngest(other, {"images/a.jpg", "scene.json"});
  const auto c = PlanIngest(more_pairs, {"images/a.jpg", "scene.json"});
  const auto d = PlanIngest(fewer_views, {"images/a.jpg", "scene.json"});
  const auto e = PlanIngest(one_split, {"images/a.jpg", "scene.json"});
  ASSERT_TRUE(a.ok() && b.ok() && c.ok() && d.ok() && e.ok());
  EXPECT_NE(a->back().parameters, e->back().parameters) << "ingest splits faces";
  EXPECT_EQ(a->size(), 1) << "one task inspects a few images itself";
  EXPECT_NE(a->back().parameters, c->back().parameters) << "ingest selects pairs";
  EXPECT_NE(a->back().parameters, d->back().parameters) << "ingest selects the views of cells";
  EXPECT_EQ(*a->back().scene_files, (std::vector<int>{0, 1}));
  EXPECT_EQ(a->back().parameters, b->back().parameters) << "ingest does not depend on the tiling";
}

TEST(PlanSurvey, TimesBeforeTheSurveyFollowTheSizesOfFiles) {
  std::vector<std::string> files = {"mesh.ply", "scene.json"};
  for (int i = 0; i < 40; ++i) files.push_back("images/" + std::to_string(100 + i) + ".jpg");
  std::sort(files.begin(), files.end());
  const auto costs = [&](int64_t mesh_bytes, int64_t image_bytes) {
    std::vector<int64_t> bytes;
    for (const std::string& file : files) {
      bytes.push_back(file == "mesh.ply" ? mesh_bytes : file == "scene.json" ? 1000 : image_bytes);
    }
    const auto tasks = PlanIngest({}, files, bytes);
    EXPECT_TRUE(tasks.ok() && tasks->size() > 2);
    return std::pair(tasks->front().cost, tasks->back().cost);  // an inspection, ingest
  };
  const auto [inspect, ingest] = costs(5'000'000, 300'000);
  const auto [same, of_large_mesh] = costs(50'000'000, 300'000);
  const auto [of_large_images, more] = costs(5'000'000, 30'000'000);
  EXPECT_EQ(same, inspect) << "an inspection reads no mesh";
  EXPECT_GT(of_large_mesh, 5 * ingest);
  EXPECT_GT(of_large_images, 50 * inspect);
  EXPECT_GT(more, ingest);
  const auto alone = PlanIngest({}, {"images/a.jpg", "mesh.ply", "scene.json"}, {30'000'000, 5'000'000, 1000});
  ASSERT_TRUE(alone.ok());
  EXPECT_GT(alone->back().cost, of_large_images / 16) << "it inspects the image itself";
}

// The files of a view are inspected together. The parts do not depend on the settings, so that they are reused.
TEST(PlanSurvey, ManyImagesAreInspectedInParts) {
  std::vector<std::string> files = {"cameras/images.bin", "cameras/points3D.bin", "mesh.ply", "scene.json"};
  constexpr int kImages = 40;
  for (int i = 0; i < kImages; ++i) {
    const std::string name = std::to_string(100 + i);
    files.push_back("images/flight/" + name + ".JPG");
    files.push_back("likelihoods/flight/" + name + ".tif");
    files.push_back("masks/flight/" + name + (i % 2 == 0 ? ".JPG.png" : ".mask.png"));
  }
  std::sort(files.begin(), files.end());
  const auto tasks = PlanIngest({.tiles = 4}, files);
  JobSettings others;
  others.method_settings.partners = 6;
  const auto again = PlanIngest(others, files);
  ASSERT_TRUE(tasks.ok() && again.ok());
  ASSERT_EQ(tasks->size(), 9);  // of five images each, and ingest
  const PlannedTask& ingest = tasks->back();
  EXPECT_EQ(ingest.kind, kIngestKind);
  EXPECT_EQ(ingest.scene_files->size(), files.size());
  ASSERT_EQ(ingest.inputs.size(), tasks->size() - 1);
  std::map<std::string, size_t> part_of;  // by path
  for (size_t t = 0; t + 1 < tasks->size(); ++t) {
    const PlannedTask& inspect = (*tasks)[t];
    EXPECT_EQ(inspect.kind, kInspectKind);
    EXPECT_TRUE(inspect.inputs.empty());
    EXPECT_EQ(inspect.parameters, (*again)[t].parameters);
    EXPECT_EQ(*inspect.scene_files, *(*again)[t].scene_files);
    EXPECT_EQ(ingest.inputs[t].task, TaskId(static_cast<int>(t)));
    EXPECT_EQ(InputName(ingest.inputs[t]), TileInputName(static_cast<int>(t), kInspectionFile));
    std::set<std::string> common = {"cameras/images.bin", "scene.json"};
    for (const int file : *inspect.scene_files) {
      if (common.erase(files[file]) > 0) continue;
      EXPECT_TRUE(part_of.emplace(files[file], t).second) << files[file];
    }
    EXPECT_TRUE(common.empty());
    EXPECT_LE(inspect.scene_files->size(), 18) << "15 files of five images, and two of cameras";
  }
  EXPECT_EQ(part_of.size(), 3 * kImages) << "mesh and 3D points are not read";
  for (int i = 0; i < kImages; ++i) {
    const std::string name = std::to_string(100 + i), image = "images/flight/" + name + ".JPG";
    EXPECT_EQ(part_of.at(image), part_of.at("likelihoods/flight/" + name + ".tif"));
    EXPECT_EQ(part_of.at(image), part_of.at("masks/flight/" + name + (i % 2 == 0 ? ".JPG.png" : ".mask.png")));
  }
}

}  // namespace
}  // namespace tessera
