// Tasks of jobs that compute likelihoods: which views, which inputs, which readers.
#include "server/plan/classify_tasks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "common/job/task_parameters.h"
#include "server/plan/graph.h"
#include "server/tiling/cost_model.h"
#include "tests/unit/server/plan/update_pair.h"

namespace tessera {
namespace {

// Classify tasks do not depend on the tiling. Tasks that read a view's pixels read its likelihoods; cuts read the
// statistics of class borders.
TEST(ClassifyTasks, TasksDoNotDependOnTiles) {
  Survey survey = RandomSurvey(12, 12, 0.8, 5);
  survey.classifier = "0123";
  for (SceneView& view : survey.views) view.likelihood_path.clear();
  std::set<int32_t> read;  // views that a cell chose, and their partners
  for (const SurveyCell& cell : survey.cells) read.insert(cell.views.begin(), cell.views.end());
  const std::set<int32_t> chosen = read;
  for (const auto& [reference, other] : survey.pairs) {
    if (chosen.contains(reference)) read.insert(other);
  }
  std::vector<std::string> of_tiles[2];
  for (const int tiles : {1, 5}) {
    JobSettings settings = {.tiles = tiles, .classifier = "/models/city.model"};
    std::vector<std::string> files = FilesOf(survey);
    files.insert(std::lower_bound(files.begin(), files.end(), kClassifierFile), kClassifierFile);
    const auto planned = PlanTiles(settings, SurveyToJson(survey), files);
    ASSERT_TRUE(planned.ok()) << planned.status();
    std::vector<PlannedTask> tasks = *PlanIngest(settings, files);
    tasks.insert(tasks.end(), planned->begin(), planned->end());
    if (tiles > 1) {
      std::vector<TileReads> reads(Cores(survey, tiles).size());
      for (int t = 0; t < static_cast<int>(reads.size()); ++t) reads[t] = {{t}, {t}, {t}, {t}};
      const auto steps = PlanSteps(settings, SurveyToJson(survey), files, reads);
      ASSERT_TRUE(steps.ok()) << steps.status();
      tasks.insert(tasks.end(), steps->begin(), steps->end());
    }
    std::set<int32_t> made;
    for (const PlannedTask& task : tasks) {
      if (task.kind == kClassifyKind) {
        of_tiles[tiles > 1].push_back(task.parameters);
        const ClassifyParameters parameters = ParseClassifyParameters(task.parameters).value();
        made.insert(parameters.view);
        EXPECT_FALSE(parameters.by_default_rule);
        ASSERT_EQ(task.scene_files->size(), 1u);
        EXPECT_EQ(files[task.scene_files->front()], kClassifierFile);
        ASSERT_EQ(task.view_files->size(), 1u);
        EXPECT_EQ(files[task.view_files->front().file], survey.views[parameters.view].image_path);
        EXPECT_EQ(ParseViews(parameters.view_json)->front().name, "") << "keys do not depend on file names";
      } else if (task.kind == kBordersKind) {
        EXPECT_EQ(task.inputs.size(), made.size());
      } else if (task.kind == kCutKind) {
        EXPECT_EQ(InputName(task.inputs.back()), kBordersFile);
        EXPECT_TRUE(ParseCutParameters(task.parameters)->borders);
      } else if (task.kind == kCropKind) {
        const size_t packages = ParseCropParameters(task.parameters)->tiles.size();
        ASSERT_EQ(task.inputs.size(), packages + task.view_files->size());
        for (size_t i = 0; i < task.view_files->size(); ++i) {
          const int32_t view = (*task.view_files)[i].view;
          EXPECT_TRUE(made.contains(view));
          EXPECT_EQ(InputName(task.inputs[packages + i]), ViewFileName(view, true));
          EXPECT_EQ(tasks[task.inputs[packages + i].task.value()].name, "classify view " + std::to_string(view));
        }
      }
    }
    EXPECT_EQ(made, read);
    EXPECT_GT(made.size(), 3u);
  }
  EXPECT_EQ(of_tiles[0], of_tiles[1]);
  EXPECT_EQ(PlanTiles({.classifier = "/models/city.model"}, SurveyToJson(survey), FilesOf(survey)).status().code(),
            absl::StatusCode::kNotFound);
}

// An update classifies the views that it reads and inherits the base's statistics of class borders.
TEST(ClassifyTasks, UpdateReusesTasksOfItsBase) {
  Pair pair(4);
  const auto classify = [](Survey* survey) {
    survey->classifier = "0123";
    for (SceneView& view : survey->views) view.likelihood_path.clear();
  };
  classify(&pair.before);
  classify(&pair.now);
  pair.base.survey_json = SurveyToJson(pair.before);
  pair.base.borders = DigestOf("borders");
  const NamedDigest model = {kClassifierFile, DigestOf("model")};
  pair.base.scene_files.push_back(model);
  std::vector<std::string> files = pair.Files();
  files.insert(files.begin(), model.name);
  const auto kinds = [](const std::vector<PlannedTask>& tasks) {
    std::map<std::string, int> count;
    for (const PlannedTask& task : tasks) ++count[task.kind.str()];
    return count;
  };
  const JobSettings settings = {.classifier = "/models/city.model"};
  const auto same = PlanTiles(settings, SurveyToJson(pair.now), files, &pair.base);
  ASSERT_TRUE(same.ok()) << same.status();
  EXPECT_EQ(kinds(*same).count(kClassifyKind), 0u);
  const int32_t view = pair.AddView(3);
  classify(&pair.now);
  files = pair.Files();
  files.insert(files.begin(), model.name);
  const auto tiles = PlanTiles(settings, SurveyToJson(pair.now), files, &pair.base);
  ASSERT_TRUE(tiles.ok()) << tiles.status();
  auto count = kinds(*tiles);
  EXPECT_EQ(count[kCutKind], 1);
  EXPECT_EQ(count[kBordersKind], 0);
  const CellRect& redone = pair.base.tiles[pair.TileOf(3)].core;
  const CellIndex cells(pair.now);
  EXPECT_EQ(count[kClassifyKind], static_cast<int>(MeasureTile(cells, redone).views.size()));
  // Tasks of the base's images have the base's keys, so their results are reused.
  std::set<std::string> of_base;
  JobSettings settings_of_base = settings;
  settings_of_base.tiles = 4;
  std::vector<std::string> files_of_base = FilesOf(pair.before);
  files_of_base.insert(files_of_base.begin(), model.name);
  const auto first_job = PlanTiles(settings_of_base, SurveyToJson(pair.before), files_of_base);
  ASSERT_TRUE(first_job.ok()) << first_job.status();
  for (const PlannedTask& task : *first_job) {
    if (task.kind == kClassifyKind) of_base.insert(task.parameters);
  }
  Survey widened = pair.now;
  for (auto& [near_m, far_m] : widened.view_depths) far_m = 2 * far_m + 100;
  const auto again = PlanTiles(settings, SurveyToJson(widened), files, &pair.base);
  ASSERT_TRUE(again.ok()) << again.status();
  int known_views = 0;
  for (const PlannedTask& task : *again) {
    if (task.kind != kClassifyKind) continue;
    if (ParseClassifyParameters(task.parameters)->view == view) continue;
    ++known_views;
    EXPECT_TRUE(of_base.contains(task.parameters)) << task.name;
  }
  EXPECT_GT(known_views, 0);
  EXPECT_EQ(ViewsToClassify(pair.before, pair.now, {0, 1, view}), std::set<int32_t>{view});

  const PlannedTask& cut = tiles->back();
  EXPECT_EQ(InputName(cut.inputs.back()), kBordersFile);
  EXPECT_EQ(cut.inputs.back().task, TaskId(0)) << "given, from the base";
  std::vector<NamedDigest> digests;
  for (const std::string& file : files) digests.push_back({file, DigestOf(file)});
  for (NamedDigest& file : digests) {
    if (file.name == kClassifierFile) file.digest = model.digest;
  }
  const auto first = PlanUpdate(settings, digests, pair.base);
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_THAT(*first->front().given, testing::Contains(NamedDigest{kBordersFile, *pair.base.borders}));
  const UpdateFiles known = ParseUpdateFiles(first->front().given_contents->front().second).value();
  EXPECT_EQ(known.known.at(pair.before.views[0].image_path).classified, pair.before.views[0].likelihood_content);
  const std::vector<int> all = {0, 1, 2, 3};
  const auto steps = PlanSteps(settings, SurveyToJson(pair.now), files, {{all, all, all, all}}, &pair.base);
  ASSERT_TRUE(steps.ok()) << steps.status();
  int compared = 0;
  for (const PlannedTask& task : *steps) {
    if (task.kind != "compare") continue;
    for (const PlannedInput& input : task.inputs) compared += InputName(input) == ViewFileName(view, true);
  }
  EXPECT_GT(compared, 0) << "new images are compared with their likelihoods";
}

}  // namespace
}  // namespace tessera
