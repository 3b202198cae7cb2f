#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>

#include "common/base/random.h"
#include "common/tile/survey.h"
#include "common/tile/task_parameters.h"
#include "server/plan/cost_model.h"
#include "server/plan/graph.h"
#include "server/plan/parts.h"
#include "server/plan/tiling.h"

namespace tessera {
namespace {

Survey RandomSurvey(int width, int height, double filled, uint64_t seed) {
  Random random(seed);
  Survey s;
  s.gsd_m = 0.1;
  s.ground = MakeGroundPlane(s.up, 8);
  s.views.resize(6);
  for (size_t v = 0; v < s.views.size(); ++v) {
    s.views[v].image_path = "images/" + std::to_string(v) + ".jpg";
    if (v % 2 == 0) s.views[v].likelihood_path = "likelihoods/" + std::to_string(v) + ".tif";
  }
  s.classes.resize(2);
  for (int y = -3; y < height - 3; ++y) {
    for (int x = -5; x < width - 5; ++x) {
      if (random.Uniform() > filled) continue;
      SurveyCell cell;
      cell.x = x;
      cell.y = y;
      cell.faces = 1 + random.Below(2000);
      cell.reach_m = random.Uniform(0, 2);
      for (int v = 0; v < 6; ++v) {
        if (random.Uniform() < 0.4) cell.views.push_back(v);
      }
      s.cells.push_back(cell);
      s.faces += cell.faces;
    }
  }
  return s;
}

std::vector<std::string> FilesOf(const Survey& survey) {
  std::vector<std::string> files = {"scene.json"};
  for (const SceneView& view : survey.views) {
    for (const std::string& path : {view.image_path, view.likelihood_path}) {
      if (!path.empty()) files.push_back(path);
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<CellRect> Cores(const Survey& survey, int tiles) {
  TilingOptions options;
  options.tiles = tiles;
  options.effort = EffortOf({});
  const auto cores = LayOutTiles(CellIndex(survey), options);
  EXPECT_TRUE(cores.ok()) << cores.status();
  return *cores;
}

std::vector<PlannedTask> PlanOf(const Survey& survey, int tiles) {
  auto plan = PlanTiles({.tiles = tiles}, SurveyToJson(survey), FilesOf(survey));
  EXPECT_TRUE(plan.ok()) << plan.status();
  return *std::move(plan);
}

TEST(Tiling, EveryCellIsInExactlyOneCoreAndNoneIsEmpty) {
  Random random(4);
  for (uint64_t seed = 0; seed < 60; ++seed) {
    const Survey survey =
        RandomSurvey(1 + static_cast<int>(random.Below(30)), 1 + static_cast<int>(random.Below(30)), 0.7, seed);
    if (survey.cells.empty()) continue;
    const auto rects = Cores(survey, static_cast<int>(random.Below(40)));
    std::vector<int> cells_in(rects.size(), 0);
    for (const SurveyCell& cell : survey.cells) {
      int owners = 0;
      for (size_t r = 0; r < rects.size(); ++r) {
        const bool inside = rects[r].Contains({cell.x, cell.y});
        owners += inside;
        cells_in[r] += inside;
      }
      EXPECT_EQ(owners, 1) << "seed " << seed;
    }
    for (const int count : cells_in) EXPECT_GT(count, 0) << "seed " << seed;
  }
}

TEST(Tiling, AsManyTilesAsAskedFor) {
  const Survey survey = RandomSurvey(30, 20, 1, 1);
  for (int tiles = 1; tiles <= 40; ++tiles) {
    EXPECT_EQ(Cores(survey, tiles).size(), static_cast<size_t>(tiles));
  }
}

TEST(Tiling, FollowsTheCitysShape) {
  const auto along_x = Cores(RandomSurvey(40, 4, 1, 1), 4);
  for (const CellRect& rect : along_x) EXPECT_EQ(rect.y1 - rect.y0, 4);
  const auto along_y = Cores(RandomSurvey(4, 40, 1, 1), 4);
  for (const CellRect& rect : along_y) EXPECT_EQ(rect.x1 - rect.x0, 4);
}

// Predicted core-seconds of refining each core, halos left out.
std::vector<double> SecondsOf(const Survey& survey, const std::vector<CellRect>& cores) {
  std::vector<double> seconds(cores.size(), 0.0);
  for (const SurveyCell& cell : survey.cells) {
    for (size_t i = 0; i < cores.size(); ++i) {
      if (cores[i].Contains({cell.x, cell.y})) seconds[i] += PredictCellSeconds(cell, survey, EffortOf({}));
    }
  }
  return seconds;
}

TEST(Tiling, TilesHaveLikeSharesOfTheWork) {
  Survey survey = RandomSurvey(60, 60, 1, 1);
  for (SurveyCell& cell : survey.cells) {  // a town in the plain
    if (std::hypot(cell.x - 10, cell.y - 20) < 12) cell.faces *= 20;
  }
  for (const int tiles : {2, 3, 9, 16, 50}) {
    const std::vector<double> seconds = SecondsOf(survey, Cores(survey, tiles));
    const double mean = std::accumulate(seconds.begin(), seconds.end(), 0.0) / tiles;
    EXPECT_LT(*std::max_element(seconds.begin(), seconds.end()), 1.3 * mean) << tiles;
  }
}

// Each view sees the whole city from above.
Survey SeenFromAbove(int size) {
  Survey survey = RandomSurvey(size, size, 1, 1);
  for (SceneView& view : survey.views) {
    view.camera.intrinsics = {8000, 8000, 8000, 8000, 4000, 4000};
    view.camera.rotation_cam_from_world.diagonal() << 1, -1, -1;
    view.camera.translation_cam_from_world.z() = 800;
  }
  for (SurveyCell& cell : survey.cells) {
    cell.box_min = {8.0 * cell.x, 8.0 * cell.y, 0};
    cell.box_max = {8.0 * cell.x + 8, 8.0 * cell.y + 8, 20};
  }
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      if (i != j) survey.pairs.push_back({i, j});
    }
  }
  survey.has_likelihoods = true;
  return survey;
}

TilingOptions WithMemory(int64_t bytes) {
  TilingOptions options;
  options.tile_bytes = bytes;
  options.halo_m = 5.6;
  options.effort = EffortOf({});
  return options;
}

TEST(Tiling, EveryTileFitsTheMemoryAndNoneIsFarTooSmall) {
  const Survey survey = SeenFromAbove(40);
  const CellIndex cells(survey);
  size_t before = 0;
  for (const int64_t mib : {8192, 4096, 3072, 2048}) {
    const TilingOptions options = WithMemory(mib << 20);
    const auto cores = LayOutTiles(cells, options);
    ASSERT_TRUE(cores.ok()) << cores.status();
    EXPECT_GE(cores->size(), before);
    before = cores->size();
    double faces = 0, filled = 0;
    for (const CellRect& core : *cores) {
      const TileWork work = MeasureTile(cells, core, options.halo_m);
      const auto bytes = static_cast<double>(PredictRefine(work, options.effort).peak_bytes);
      EXPECT_LE(RefineBytesInterval().high * bytes, static_cast<double>(options.tile_bytes));
      faces += work.core_faces;
      filled += bytes / static_cast<double>(options.tile_bytes);
    }
    EXPECT_EQ(faces, static_cast<double>(survey.faces));
    if (cores->size() > 1) {
      EXPECT_GT(filled / static_cast<double>(cores->size()), 0.5);
    }
  }
  EXPECT_GT(before, 1u);
}

TEST(Tiling, ANumberOfTilesIsKeptUnlessMemoryIsLimitedToo) {
  const Survey survey = SeenFromAbove(40);
  EXPECT_EQ(Cores(survey, 1).size(), 1u);
  TilingOptions options = WithMemory(int64_t{512} << 20);
  options.tiles = 2;
  EXPECT_GT(LayOutTiles(CellIndex(survey), options)->size(), 2u);
}

TEST(Tiling, ACellThatCannotFitIsRefusedWithWhatToDo) {
  Survey survey = SeenFromAbove(4);
  survey.cells[5].faces = 4'000'000;
  const auto refused = PlanTiles({.tile_memory_bytes = int64_t{3} << 30}, SurveyToJson(survey), FilesOf(survey));
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
  const std::string message(refused.status().message());
  for (const char* word : {"cell at (", "--tile-memory", "--levels", "found 3.00 GiB"}) {
    EXPECT_NE(message.find(word), std::string::npos) << message;
  }
  EXPECT_TRUE(PlanTiles({.tile_memory_bytes = int64_t{8} << 30}, SurveyToJson(survey), FilesOf(survey)).ok());
}

TEST(CostModel, CropsAreWhatTheTileCovers) {
  const Survey survey = SeenFromAbove(40);
  const CellIndex cells(survey);
  // 10 pixels a metre at height 0, a little more at the boxes' tops, and the crops' margin.
  const TileWork work = MeasureTile(cells, {0, 0, 10, 5}, 0);
  EXPECT_EQ(work.views.size(), 6u);
  EXPECT_EQ(work.seeing_views, 6);
  EXPECT_GT(work.pixels, 6 * 800.0 * 400.0);
  EXPECT_LT(work.pixels, 6 * 950.0 * 530.0);
  EXPECT_NEAR(work.pair_pixels, 5 * work.pixels, 1e-3);
  EXPECT_EQ(work.image_pixels, 6 * 64e6);
  const TileWork wider = MeasureTile(cells, {0, 0, 10, 5}, 8);
  EXPECT_GT(wider.faces, work.faces);
  EXPECT_EQ(wider.core_faces, work.core_faces);
  EXPECT_GT(wider.pixels, work.pixels);
}

TEST(CostModel, APartOfACellCountsForItsShare) {
  Survey survey = SeenFromAbove(40);
  for (SurveyCell& cell : survey.cells) cell.faces = 100;
  const CellIndex cells(survey);
  const CellRect core = {5, 5, 10, 10};
  EXPECT_EQ(MeasureTile(cells, core, 0).faces, 2500);
  EXPECT_EQ(MeasureTile(cells, core, 4).faces, 3600);
  EXPECT_EQ(MeasureTile(cells, core, 8).faces, 4900);
}

TEST(CostModel, CoarserLevelsTakeLess) {
  JobSettings coarse, twice;
  coarse.method_settings.levels = {2, 1};
  coarse.method_settings.iterations = {3, 10};
  twice.rounds = 2;
  const Survey survey = SeenFromAbove(20);
  const TileWork work = MeasureTile(CellIndex(survey), {-5, -3, 15, 17}, 0);
  const Prediction standard = PredictRefine(work, EffortOf({})), less = PredictRefine(work, EffortOf(coarse));
  EXPECT_LE(less.peak_bytes, standard.peak_bytes);
  EXPECT_LT(less.core_seconds, standard.core_seconds);
  EXPECT_GT(PredictRefine(work, EffortOf(twice)).core_seconds, standard.core_seconds);
}

TEST(Plan, ProducersComeFirstAndEveryInputIsMade) {
  static const std::map<std::string, std::set<std::string>> kOutputs = {
      {"ingest", {kCityFile, kSurveyFile}}, {"cut", {kTileFile}}, {"crop", {kViewsFile}}, {"refine", {kResultFile}}, {"stitch", {kCoreFile}}};
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
