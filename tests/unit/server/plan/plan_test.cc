#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>

#include "common/tile/task_parameters.h"
#include "server/plan/graph.h"
#include "server/plan/parts.h"
#include "tests/unit/server/plan/small_surveys.h"

namespace tessera {
namespace {

std::vector<PlannedTask> PlanOf(const Survey& survey, int tiles) {
  auto plan = PlanTiles({.tiles = tiles}, SurveyToJson(survey), FilesOf(survey));
  EXPECT_TRUE(plan.ok()) << plan.status();
  return *std::move(plan);
}
TEST(Plan, ProducersComeFirstAndEveryInputIsMade) {
  static const std::map<std::string, std::set<std::string>> kOutputs = {{"ingest", {kCityFile, kSurveyFile}},
                                                                        {"cut", {kTileFile}},
                                                                        {"crop", {kViewsFile}},
                                                                        {"refine", {kResultFile}},
                                                                        {"stitch", {kCoreFile}}};
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const Survey survey = RandomSurvey(20, 14, 0.8, seed);
    const auto tasks = PlanOf(survey, static_cast<int>(seed));
    std::set<std::string> names;
    for (size_t t = 0; t < tasks.size(); ++t) {
      EXPECT_TRUE(names.insert(tasks[t].name).second) << tasks[t].name;
      EXPECT_GT(tasks[t].cost, 0);
      std::set<std::string> inputs;
      for (const PlannedInput& input : tasks[t].inputs) {
        EXPECT_TRUE(inputs.insert(input.name).second) << input.name << " twice";
        ASSERT_GE(input.task, 0);
        ASSERT_LT(input.task, static_cast<int>(t) + 1) << "the ingest task has index 0";
        const std::string kind = input.task == 0 ? "ingest" : tasks[input.task - 1].kind;
        EXPECT_TRUE(kOutputs.at(kind).contains(input.output)) << kind << " makes no " << input.output;
      }
    }
    EXPECT_EQ(tasks.back().kind, "publish");
  }
}

TEST(Plan, CropReadsThePixelsOfEveryViewOfItsCells) {
  const Survey survey = RandomSurvey(12, 12, 0.8, 5);
  const std::vector<std::string> all = FilesOf(survey);
  for (const PlannedTask& task : PlanOf(survey, 5)) {
    if (task.kind != "crop") continue;
    std::set<std::string> files;
    for (const int file : task.scene_files) files.insert(all.at(file));
    const auto cores = Cores(survey, 5);
    for (const SurveyCell& cell : survey.cells) {
      if (!cores[task.tile].Contains({cell.x, cell.y})) continue;
      for (const int32_t v : cell.views) {
        EXPECT_TRUE(files.contains(survey.views[v].image_path));
        if (!survey.views[v].likelihood_path.empty()) {
          EXPECT_TRUE(files.contains(survey.views[v].likelihood_path));
        }
      }
    }
  }
}

TEST(Plan, AViewWhoseFileTheSceneLacksIsNamed) {
  const Survey survey = RandomSurvey(3, 3, 1, 1);
  const auto refused = PlanTiles({.tiles = 1}, SurveyToJson(survey), {"images/0.jpg", "scene.json"});
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(refused.status().message(), "the scene has no file likelihoods/0.tif");
}

// A huge face reaches far; tiles that it does not touch must not read more for it.
TEST(Plan, AHugeFaceAddsReadersOnlyAroundIt) {
  Survey survey = RandomSurvey(40, 40, 1, 2);
  for (SurveyCell& cell : survey.cells) cell.reach_m = 1;
  const auto reads = [&] {
    std::map<int, size_t> count;
    for (const PlannedTask& task : PlanOf(survey, 100)) {
      if (task.kind == "stitch") count[task.tile] = task.inputs.size();
    }
    return count;
  };
  const auto before = reads();
  survey.cells.front().reach_m = 8 * 10;  // as far as ten cells
  const auto after = reads();
  EXPECT_GT(after.at(0), before.at(0));
  size_t more = 0;
  for (const auto& [tile, count] : after) more += count > before.at(tile);
  EXPECT_LT(more, 30u);
}

TEST(Plan, BothSidesOfASeamReadTheSameTiles) {
  const Survey survey = RandomSurvey(30, 30, 0.9, 2);
  std::map<int, std::set<int>> reads;
  for (const PlannedTask& task : PlanOf(survey, 25)) {
    if (task.kind != "stitch") continue;
    const auto parameters = ParseStitchParameters(task.parameters);
    ASSERT_TRUE(parameters.ok());
    EXPECT_EQ(parameters->results.size() + 1, task.inputs.size());
    for (const TileParameters& tile : parameters->results) reads[task.tile].insert(tile.tile);
  }
  const auto cores = Cores(survey, 25);
  for (const auto& [tile, others] : reads) {
    EXPECT_TRUE(others.contains(tile));
    for (size_t other = 0; other < cores.size(); ++other) {
      if (DistanceBetween(cores[tile], cores[other], survey.ground.cell_m) == 0) {
        EXPECT_TRUE(others.contains(static_cast<int>(other)));
      }
    }
  }
}

TEST(Plan, SameSurveySamePlan) {
  const Survey survey = RandomSurvey(20, 20, 0.8, 3);
  const auto a = PlanOf(survey, 7), b = PlanOf(survey, 7);
  ASSERT_EQ(a.size(), b.size());
  for (size_t t = 0; t < a.size(); ++t) {
    EXPECT_EQ(a[t].parameters, b[t].parameters);
    EXPECT_EQ(a[t].cost, b[t].cost);
  }
}

TEST(Plan, OneTileIsTheUntiledRun) {
  const auto tasks = PlanOf(RandomSurvey(20, 20, 0.8, 3), 1);
  ASSERT_EQ(tasks.size(), 5u);
  EXPECT_EQ(tasks[2].kind, "refine");
}

TEST(Plan, SettingsAreRefusedAllAtOnce) {
  const auto refused = PlanIngest({.tiles = -1, .rounds = 1000, .method = "magic"}, {"scene.json"});
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
  const std::string message(refused.status().message());
  for (const char* word : {"tiles: found -1", "rounds: found 1000", "method: found \"magic\""}) {
    EXPECT_NE(message.find(word), std::string::npos) << message;
  }
  EXPECT_FALSE(PlanIngest({}, {}).ok());
  EXPECT_FALSE(PlanTiles({}, "not json", {}).ok());
}

// The parameters of the job's first task of a kind.
std::string ParametersOf(const JobSettings& settings, const std::string& kind) {
  const Survey survey = RandomSurvey(6, 6, 1, 1);
  const auto tasks = PlanTiles(settings, SurveyToJson(survey), FilesOf(survey));
  EXPECT_TRUE(tasks.ok()) << tasks.status();
  for (const PlannedTask& task : *tasks) {
    if (task.kind == kind) return task.parameters;
  }
  return "";
}

TEST(Plan, RefineKnowsMethodAndSettings) {
  std::set<std::string> seen;
  for (const char* method : kMethods) {
    JobSettings settings;
    settings.method = method;
    EXPECT_TRUE(seen.insert(ParametersOf(settings, "refine")).second) << method;
    settings.rounds = 2;
    EXPECT_TRUE(seen.insert(ParametersOf(settings, "refine")).second) << method;
    settings.method_settings.thin_plate = 0.7;
    const std::string parameters = ParametersOf(settings, "refine");
    EXPECT_TRUE(seen.insert(parameters).second) << method;
    const auto parsed = ParseRefineParameters(parameters);
    ASSERT_TRUE(parsed.ok()) << parsed.status();
    EXPECT_EQ(parsed->method, method);
    EXPECT_EQ(parsed->rounds, 2);
    EXPECT_EQ(parsed->settings, settings.method_settings);
  }
  JobSettings unnamed, named;
  unnamed.method = "";
  EXPECT_EQ(ParametersOf(unnamed, "refine"), ParametersOf(named, "refine"));
}

TEST(Plan, HaloGrowsWithTheReachOfWindowsAndLevels) {
  const auto halo_m = [](const MethodSettings& method_settings) {
    JobSettings settings;
    settings.method_settings = method_settings;
    return ParseCutParameters(ParametersOf(settings, "cut"))->halo_m;
  };
  MethodSettings wide, narrow, coarse, standard;
  wide.window_px = 11;
  narrow.window_px = 3;
  coarse.levels = {3, 1, 0};
  standard.levels = {2, 1, 0};
  const double by_default = halo_m({});
  EXPECT_EQ(halo_m(standard), by_default);
  EXPECT_EQ(halo_m(narrow), by_default);
  EXPECT_NEAR(halo_m(wide), by_default * 11 / 7, 1e-9);
  EXPECT_NEAR(halo_m(coarse), by_default * 2, 1e-9);
}

TEST(Parts, HoldEveryStepOnceAndGrowWithTheHalo) {
  Random random(3);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<int> levels, iterations;
    for (int level = static_cast<int>(random.Below(5)); level >= 0; --level) {
      if (random.Below(3) == 0) continue;
      levels.push_back(level);
      iterations.push_back(static_cast<int>(random.Below(12)));
    }
    const auto steps = MakeRefineSteps(levels, iterations, 1 + static_cast<int>(random.Below(3)));
    size_t last = steps.size() + 1;
    for (const double reach_gsd : {0.0, 100.0, 200.0, 400.0, 1e9}) {
      const std::vector<StepRange> parts = SplitSteps(steps, 7, reach_gsd);
      int next = 0;
      for (const StepRange& part : parts) {
        EXPECT_EQ(part.begin, next);
        EXPECT_GT(part.end, part.begin);
        next = part.end;
      }
      EXPECT_EQ(next, static_cast<int>(steps.size()));
      EXPECT_LE(parts.size(), last);
      last = parts.size();
    }
    EXPECT_EQ(last, 1u);
  }
}

// What a part goes on from must hold every vertex and face of the tile with its halo.
TEST(Parts, ReadTheResultsOfAllTilesThatTheHaloTouches) {
  const Survey survey = RandomSurvey(30, 30, 0.9, 2);
  const auto tasks = PlanOf(survey, 9);
  const auto cores = Cores(survey, 9);
  int later = 0;
  for (size_t t = 0; t < tasks.size(); ++t) {
    if (tasks[t].kind != "refine") continue;
    const auto parameters = ParseRefineParameters(tasks[t].parameters);
    ASSERT_TRUE(parameters.ok()) << parameters.status();
    EXPECT_EQ(parameters->tile.core, cores[tasks[t].tile]);
    if (parameters->begin == 0) {
      EXPECT_TRUE(parameters->results.empty());
      continue;
    }
    ++later;
    std::set<int> read;
    for (const TileParameters& tile : parameters->results) read.insert(tile.tile);
    for (const PlannedInput& input : tasks[t].inputs) {
      if (input.output != kResultFile) continue;
      const auto before = ParseRefineParameters(tasks[input.task - 1].parameters);
      EXPECT_EQ(before->end, parameters->begin);
      EXPECT_EQ(read.erase(before->tile.tile), 1u);
    }
    EXPECT_TRUE(read.empty());
    const double halo_m = *HaloOf({}, survey);
    for (const TileParameters& tile : parameters->results) read.insert(tile.tile);
    for (size_t other = 0; other < cores.size(); ++other) {
      if (DistanceBetween(cores[other], parameters->tile.core, survey.ground.cell_m) > halo_m) continue;
      EXPECT_TRUE(read.contains(static_cast<int>(other)));
    }
  }
  EXPECT_GE(later, 9);
}

TEST(Plan, IngestReadsTheWholeSceneAndDependsOnNothingElse) {
  JobSettings one, other, more_pairs, fewer_views;
  one.tiles = 1;
  other.tiles = 9;
  other.rounds = 3;
  other.method = "paper";
  other.method_settings.window_px = 9;
  more_pairs.method_settings.partners = 6;
  fewer_views.method_settings.views_per_direction = 3;
  const auto a = PlanIngest(one, {"images/a.jpg", "scene.json"});
  const auto b = PlanIngest(other, {"images/a.jpg", "scene.json"});
  const auto c = PlanIngest(more_pairs, {"images/a.jpg", "scene.json"});
  const auto d = PlanIngest(fewer_views, {"images/a.jpg", "scene.json"});
  ASSERT_TRUE(a.ok() && b.ok() && c.ok() && d.ok());
  EXPECT_NE(a->parameters, c->parameters) << "ingest chooses the pairs";
  EXPECT_NE(a->parameters, d->parameters) << "and the views of cells";
  EXPECT_EQ(a->scene_files, (std::vector<int>{0, 1}));
  EXPECT_EQ(a->parameters, b->parameters) << "so that it is done once for all tilings";
}

}  // namespace
}  // namespace tessera
