#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "common/job/refine_steps.h"
#include "common/job/task_parameters.h"
#include "server/plan/crop_tasks.h"
#include "server/plan/graph.h"
#include "tests/support/small_surveys.h"

namespace tessera {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;

// Each tile reads itself and its neighbours; how many depends on the operator.
std::vector<TileReads> RandomReads(int tiles, Random& random) {
  const auto some = [&](int tile) {
    std::vector<int> ids;
    for (int other = 0; other < tiles; ++other) {
      if (other == tile || random.Uniform() < 0.3) ids.push_back(other);
    }
    return ids;
  };
  std::vector<TileReads> reads;
  for (int tile = 0; tile < tiles; ++tile) reads.push_back({some(tile), some(tile), some(tile), some(tile)});
  return reads;
}

// All tasks of a job. The second split, if there is one, changes no cell of the survey.
std::vector<PlannedTask> PlanOf(const Survey& survey, const JobSettings& settings,
                                const std::vector<TileReads>& reads) {
  const std::vector<std::string> files = FilesOf(survey);
  std::vector<PlannedTask> tasks = *PlanIngest(settings, files);
  const auto append = [&](const StatusOr<std::vector<PlannedTask>>& phase) {
    ASSERT_TRUE(phase.ok()) << phase.status();
    tasks.insert(tasks.end(), phase->begin(), phase->end());
  };
  append(PlanTiles(settings, SurveyToJson(survey), files));
  if (tasks.back().kind == kCutKind) append(PlanSteps(settings, SurveyToJson(survey), files, reads));
  if (tasks.back().kind == kPublishKind) return tasks;
  const int size = static_cast<int>(tasks.size());
  FinePart fine = {SurveyToJson(survey), TaskId(size - 1), size};
  for (int t = 0; t < size; ++t) {
    fine.crops.merge(CropsByTile(tasks[t], TaskId(t)));
  }
  append(PlanTiles(settings, SurveyToJson(survey), files, nullptr, &fine));
  if (tasks.back().kind == kCutKind) {
    append(PlanSteps(settings, SurveyToJson(survey), files, reads, nullptr, {}, &fine));
  }
  return tasks;
}

std::vector<PlannedTask> PlanOf(const Survey& survey, int tiles) {
  Random random(7);
  const int count = static_cast<int>(Cores(survey, tiles).size());
  return PlanOf(survey, {.tiles = tiles}, RandomReads(count, random));
}

// A task and its inputs: "crop tile 0: tile.arrays of cut tile 0".
std::string Line(const std::vector<PlannedTask>& tasks, const PlannedTask& task) {
  std::string line = task.name;
  const char* before = ": ";
  for (const PlannedInput& input : task.inputs) {
    line += before;
    line += InputName(input) + " of " + tasks.at(input.task.value()).name;
    before = ", ";
  }
  return line;
}

std::vector<std::string> Lines(const std::vector<PlannedTask>& tasks) {
  std::vector<std::string> lines;
  for (const PlannedTask& task : tasks) lines.push_back(Line(tasks, task));
  return lines;
}

TEST(Plan, EveryInputIsAnOutputOfAnEarlierTask) {
  static const std::map<std::string, std::set<std::string>> kOutputs = {
      {"ingest", {kCityFile, kSurveyFile, kPlainSurveyFile}},
      {"cut", {kTileFile, kReadsFile}},
      {"crop", {kViewsFile}},
      {"measure", {kSumsFile}},
      {"solve", {kStateFile}},
      {"mend", {kStateFile}},
      {"refine", {kStateFile}},
      {"split", {kCityFile, kMovedFile, kSurveyFile, kPlainSurveyFile}},
      {"start", {kStateFile}}};
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const Survey survey = RandomSurvey(20, 14, 0.8, seed);
    const auto tasks = PlanOf(survey, static_cast<int>(seed));
    std::set<std::string> names;
    for (size_t t = 0; t < tasks.size(); ++t) {
      EXPECT_TRUE(names.insert(tasks[t].name).second) << tasks[t].name;
      EXPECT_GT(tasks[t].cost, 0);
      std::set<std::string> inputs;
      for (const PlannedInput& input : tasks[t].inputs) {
        EXPECT_TRUE(inputs.insert(InputName(input)).second) << InputName(input) << " twice";
        ASSERT_GE(input.task.value(), 0);
        ASSERT_LT(input.task.value(), static_cast<int>(t));
        const PlannedTask& producer = tasks[input.task.value()];
        EXPECT_TRUE(kOutputs.at(producer.kind).contains(input.output)) << producer.kind << " " << input.output;
        if (producer.kind == kCropKind && input.tile >= 0) {
          EXPECT_THAT(ParseCropParameters(producer.parameters)->tiles, Contains(input.tile));
        } else if (input.tile >= 0) {
          EXPECT_EQ(producer.tile, input.tile);
        }
      }
    }
    EXPECT_EQ(tasks.back().kind, "publish");
  }
}

TEST(Plan, OneTileIsRefinedByOneTask) {
  JobSettings settings = {.tiles = 1};
  settings.method_settings.levels = {0};
  settings.method_settings.iterations = {2};
  EXPECT_THAT(Lines(PlanOf(RandomSurvey(20, 20, 0.8, 3), settings, {})),
              ElementsAre("ingest", "cut tile 0: city.arrays of ingest, plain.json of ingest",
                          "crop tile 0: 0000/tile.arrays of cut tile 0",
                          "refine tile 0: tile.arrays of cut tile 0, views.arrays of crop tile 0",
                          "publish: city.arrays of ingest, plain.json of ingest, 0000/state.arrays of refine tile 0"));
}

TEST(Plan, FinestLevelHasFacesOfItsOwn) {
  const std::vector<PlannedTask> tasks = PlanOf(RandomSurvey(20, 20, 0.8, 3), 1);
  EXPECT_THAT(
      Lines(tasks),
      ElementsAre("ingest", "cut tile 0: city.arrays of ingest, plain.json of ingest",
                  "crop tile 0: 0000/tile.arrays of cut tile 0",
                  "refine tile 0: tile.arrays of cut tile 0, views.arrays of crop tile 0",
                  "split: city.arrays of ingest, survey.json of ingest, 0000/state.arrays of refine tile 0",
                  "cut tile 0, finest level: city.arrays of split, plain.json of split, moved.arrays of split",
                  "start tile 0, finest level: city.arrays of split, plain.json of split, moved.arrays of split",
                  "crop tile 0, finest level: 0000/tile.arrays of cut tile 0, finest level, "
                  "0000/views.arrays of crop tile 0",
                  "refine tile 0, finest level: tile.arrays of cut tile 0, finest level, views.arrays of crop "
                  "tile 0, finest level, 0000/views.arrays of crop tile 0, 0000/state.arrays of start tile 0, "
                  "finest level",
                  "publish: city.arrays of split, plain.json of split, 0000/state.arrays of refine tile 0, "
                  "finest level"));
  EXPECT_TRUE(ParseIngestParameters(tasks[0].parameters)->coarse_faces);
  EXPECT_EQ(ParseCutParameters(tasks[1].parameters)->coarsest_level, 2);
  EXPECT_EQ(ParseCutParameters(tasks[5].parameters)->coarsest_level, 0);
  EXPECT_EQ(ParseRefineParameters(tasks[3].parameters)->part, JobPart::kCoarse);
  EXPECT_EQ(ParseRefineParameters(tasks[8].parameters)->part, JobPart::kFine);
  double later = 0;
  for (size_t t = 5; t < tasks.size(); ++t) later += tasks[t].cost;
  EXPECT_GT(tasks[4].later_cost, 0.5 * later);
  EXPECT_LT(tasks[4].later_cost, 2 * later);
}

// A cell that no tile had is added to one; a tile whose cells lost all faces has no tasks.
TEST(Plan, TilesOfTheFinestLevelCoverItsCells) {
  Survey survey = SeenFromAbove(20);
  const JobSettings settings = {.tiles = 4};
  const std::vector<CellRect> cores = Cores(survey, 4);
  const std::vector<std::string> files = FilesOf(survey);
  Survey split = survey;
  split.cells.push_back(split.cells.back());
  ++split.cells.back().x;
  std::erase_if(split.cells, [&](const SurveyCell& cell) { return cores[1].Contains({cell.x, cell.y}); });
  const FinePart fine = {SurveyToJson(split), TaskId(90), 91, {2}, {{0, TaskId(7)}, {1, TaskId(7)}, {3, TaskId(8)}}};
  const auto cuts = PlanTiles(settings, SurveyToJson(survey), files, nullptr, &fine);
  ASSERT_TRUE(cuts.ok()) << cuts.status();
  std::vector<CellRect> grown;
  std::vector<int> cut;
  for (const PlannedTask& task : *cuts) {
    ASSERT_EQ(task.kind, kCutKind);
    cut.push_back(task.tile);
    grown = ParseCutParameters(task.parameters)->cores;
    EXPECT_EQ(task.inputs[0].task, TaskId(90));
  }
  EXPECT_THAT(cut, ElementsAre(0, 3)) << "1 has no faces, 2 failed before";
  for (const SurveyCell& cell : split.cells) {
    EXPECT_EQ(std::count_if(grown.begin(), grown.end(),
                            [&](const CellRect& core) { return core.Contains({cell.x, cell.y}); }),
              1);
  }
  const TileReads both = {{0, 3}, {0, 3}, {0, 3}, {0, 3}};
  const auto steps = PlanSteps(settings, SurveyToJson(survey), files, {both, both}, nullptr,
                               {{.tile = 2, .kind = kSolveKind, .step = 3}}, &fine);
  ASSERT_TRUE(steps.ok()) << steps.status();
  std::vector<std::string> first;
  for (size_t t = 0; t < 4; ++t) first.push_back((*steps)[t].name);
  EXPECT_THAT(first, ElementsAre("start tile 0, finest level", "start tile 2, finest level",
                                 "start tile 3, finest level", "crop tiles 0 to 3, finest level"));
  std::vector<std::pair<std::string, TaskId>> read;
  for (const PlannedInput& input : (*steps)[3].inputs) read.emplace_back(InputName(input), input.task);
  EXPECT_THAT(
      read, ElementsAre(testing::Pair("0000/tile.arrays", TaskId(91)), testing::Pair("0000/views.arrays", TaskId(7)),
                        testing::Pair("0003/tile.arrays", TaskId(92)), testing::Pair("0003/views.arrays", TaskId(8))));
  EXPECT_EQ((*steps)[3].parameters, R"({"coarse":[0,3],"tiles":[0,3]})");
  const auto publish = ParsePublishParameters(steps->back().parameters);
  EXPECT_THAT(publish->quarantined, ElementsAre(2));
  EXPECT_TRUE(publish->tiles[1].core.empty());
  EXPECT_EQ(steps->back().inputs.size(), 2 + 3u);
  EXPECT_EQ(steps->back().inputs[3].task, TaskId(91 + 2 + 1)) << "tile 2 keeps the state with which it starts";
}

// Steps: labels, two iterations of one level, labels. Tile 0 has no neighbours; 1 to 3 are in a row.
TEST(Plan, FourTilesExchangeAtEveryStep) {
  Survey survey = SeenFromAbove(20);
  survey.has_labels = true;
  JobSettings settings = {.tiles = 4, .rounds = 1};
  settings.method_settings.levels = {0};
  settings.method_settings.iterations = {2};
  std::vector<TileReads> reads = {{{0}, {0}, {0, 1}, {0}},
                                  {{1, 2}, {1}, {0, 1, 2, 3}, {1, 2}},
                                  {{1, 2, 3}, {2}, {1, 2, 3}, {1, 2, 3}},
                                  {{2, 3}, {2, 3}, {3}, {2, 3}}};
  const auto tasks = PlanOf(survey, settings, reads);
  std::vector<std::string> names;
  for (const PlannedTask& task : tasks) names.push_back(task.name);
  std::vector<std::string> expected = {"ingest"};
  const auto of_tiles = [&](const std::string& kind, const std::string& rest) {
    for (const char* tile : {" tile 0", " tile 1", " tile 2", " tile 3"}) expected.push_back(kind + tile + rest);
  };
  of_tiles("cut", "");
  expected.push_back("crop tiles 0 to 3");
  of_tiles("measure", " step 0");
  of_tiles("solve", " step 0");
  of_tiles("mend", " before step 1");
  for (const char* step : {" step 1", " step 2"}) {
    of_tiles("measure", step);
    of_tiles("solve", step);
  }
  of_tiles("mend", " step 2");
  of_tiles("measure", " step 3");
  of_tiles("solve", " step 3");
  expected.push_back("publish");
  ASSERT_EQ(names, expected);

  const auto line = [&](const std::string& name) {
    const auto it = std::find(names.begin(), names.end(), name);
    return Line(tasks, tasks[it - names.begin()]);
  };
  EXPECT_EQ(line("measure tile 1 step 0"),
            "measure tile 1 step 0: tile.arrays of cut tile 1, views.arrays of crop tiles 0 to 3");
  EXPECT_EQ(line("solve tile 3 step 0"),
            "solve tile 3 step 0: tile.arrays of cut tile 3, 0002/sums.arrays of measure tile 2 step 0, "
            "0003/sums.arrays of measure tile 3 step 0");
  EXPECT_EQ(line("mend tile 3 before step 1"),
            "mend tile 3 before step 1: tile.arrays of cut tile 3, 0002/state.arrays of solve tile 2 step 0, "
            "0003/state.arrays of solve tile 3 step 0");
  EXPECT_EQ(line("measure tile 1 step 1"),
            "measure tile 1 step 1: tile.arrays of cut tile 1, views.arrays of crop tiles 0 to 3, "
            "0000/state.arrays of mend tile 0 before step 1, 0001/state.arrays of mend tile 1 before step 1, "
            "0002/state.arrays of mend tile 2 before step 1, 0003/state.arrays of mend tile 3 before step 1");
  EXPECT_EQ(line("solve tile 2 step 2"),
            "solve tile 2 step 2: tile.arrays of cut tile 2, 0001/sums.arrays of measure tile 1 step 2, "
            "0002/sums.arrays of measure tile 2 step 2, 0003/sums.arrays of measure tile 3 step 2, "
            "0001/state.arrays of solve tile 1 step 1, 0002/state.arrays of solve tile 2 step 1, "
            "0003/state.arrays of solve tile 3 step 1");
  EXPECT_EQ(line("measure tile 3 step 3"),
            "measure tile 3 step 3: tile.arrays of cut tile 3, views.arrays of crop tiles 0 to 3, "
            "0003/state.arrays of mend tile 3 step 2");
  EXPECT_EQ(line("publish"),
            "publish: city.arrays of ingest, plain.json of ingest, 0000/state.arrays of solve tile 0 step 3, "
            "0001/state.arrays of solve tile 1 step 3, 0002/state.arrays of solve tile 2 step 3, "
            "0003/state.arrays of solve tile 3 step 3");

  // The parameters list the tiles whose states and sums are inputs.
  for (const PlannedTask& task : tasks) {
    if (task.kind != "measure" && task.kind != "solve" && task.kind != "mend") continue;
    const auto parameters = ParseStepParameters(task.parameters);
    ASSERT_TRUE(parameters.ok()) << parameters.status();
    EXPECT_EQ(parameters->tile.tile, task.tile);
    EXPECT_EQ(parameters->before, task.name.find("before") != std::string::npos);
    std::vector<int> states, sums;
    for (const PlannedInput& input : task.inputs) {
      if (input.output == kStateFile) states.push_back(input.tile);
      if (input.output == kSumsFile) sums.push_back(input.tile);
    }
    EXPECT_EQ(parameters->states, states);
    EXPECT_EQ(parameters->sums, sums);
  }
}

// Number of tasks per kind and tile.
std::map<std::string, int> CountsOf(const Survey& survey, const JobSettings& settings) {
  Random random(1);
  std::map<std::string, int> counts;
  for (const PlannedTask& task : PlanOf(survey, settings, RandomReads(settings.tiles, random))) {
    if (task.tile == 0) ++counts[task.kind];
  }
  return counts;
}

TEST(Plan, OnlyActiveStepsHaveTasks) {
  Survey survey = SeenFromAbove(20);
  survey.has_labels = true;
  JobSettings settings = {.tiles = 4};
  const int levels = 3;  // later rounds stay at the finest level
  const auto expect = [&](int labellings, int rounds) {
    const auto counts = CountsOf(survey, settings);
    const bool standard = settings.method.empty() || settings.method == "tessera";
    const int finest = standard ? 6 : 8, again = settings.method == "paper" ? 8 : standard ? 3 : 4;
    const int steps = 4 + 8 + finest + again * (rounds - 1) + labellings;
    EXPECT_EQ(counts.at("measure"), steps);
    EXPECT_EQ(counts.at("solve"), steps);
    EXPECT_EQ(counts.at("mend"), 1 + levels + rounds - 1);
  };
  expect(3, 2);
  settings.method_settings.labels_first = false;
  expect(2, 2);
  survey.has_labels = false;  // the geometry needs labels
  expect(3, 2);
  settings.method = "baseline";
  settings.method_settings = {};
  expect(1, 1);
  settings.method_settings.labels_first = true;
  expect(2, 1);
  settings.method = "paper";
  settings.method_settings = {};
  expect(6, 5);
  survey.has_labels = true;
  expect(5, 5);
  survey.has_likelihoods = false;
  expect(0, 5);
  settings.rounds = 2;
  expect(0, 2);
  survey.has_likelihoods = true;
  survey.classes.resize(1);
  expect(0, 2);
}

TEST(Plan, InconsistentReadsAreRefused) {
  const Survey survey = RandomSurvey(20, 20, 0.8, 3);
  const auto plan = [&](const std::vector<TileReads>& reads) {
    return PlanSteps({.tiles = 2}, SurveyToJson(survey), FilesOf(survey), reads).status();
  };
  const TileReads both = {{0, 1}, {0, 1}, {0, 1}, {0, 1}};
  EXPECT_TRUE(plan({both, both}).ok());
  EXPECT_THAT(std::string(plan({both}).message()), HasSubstr("found 1 tiles, expected 2"));
  EXPECT_EQ(plan({both, {{0, 1}, {1}, {1, 2}, {1}}}).code(), absl::StatusCode::kInvalidArgument);
}

TEST(Plan, CutParametersContainAllCores) {
  const Survey survey = RandomSurvey(20, 20, 0.8, 3);
  const auto cores = Cores(survey, 6);
  for (const PlannedTask& task : PlanOf(survey, 6)) {
    if (task.kind != "cut") continue;
    const auto parameters = ParseCutParameters(task.parameters);
    ASSERT_TRUE(parameters.ok()) << parameters.status();
    EXPECT_EQ(parameters->cores, cores);
    EXPECT_EQ(parameters->tile.core, cores[task.tile]);
  }
}

TEST(Plan, CropReadsAllViewsOfItsCells) {
  const Survey survey = RandomSurvey(12, 12, 0.8, 5);
  const std::vector<std::string> all = FilesOf(survey);
  const auto cores = Cores(survey, 5);
  std::vector<int> cropped;
  for (const PlannedTask& task : PlanOf(survey, 5)) {
    if (task.kind != "crop") continue;
    std::set<std::string> files;
    for (const PlannedTask::ViewFile& file : *task.view_files) files.insert(all.at(file.file));
    EXPECT_EQ(files.size(), task.view_files->size());
    const CropParameters parameters = ParseCropParameters(task.parameters).value();
    for (const int tile : parameters.tiles) {
      cropped.push_back(tile);
      for (const SurveyCell& cell : survey.cells) {
        if (!cores[tile].Contains({cell.x, cell.y})) continue;
        for (const int32_t v : cell.views) {
          const std::string& likelihoods = survey.views[v].likelihood_path;
          EXPECT_TRUE(files.contains(survey.views[v].image_path));
          EXPECT_TRUE(likelihoods.empty() || files.contains(likelihoods));
        }
      }
    }
  }
  EXPECT_THAT(cropped, ElementsAre(0, 1, 2, 3, 4, 0, 1, 2, 3, 4)) << "in both parts";
}

// The tile of a crop that failed for good is quarantined; each of the others is cropped alone. Tiles that are
// quarantined later on stay in their group, whose crops are made.
TEST(Plan, QuarantinedTilesAreNotCropped) {
  const Survey survey = SeenFromAbove(20);
  const auto crops = [&](const std::vector<FailedTile>& failed, int cut = 4) {
    const std::vector<TileReads> reads(cut, TileReads{{0, 1, 2, 3}, {0, 1, 2, 3}, {0, 1, 2, 3}, {0, 1, 2, 3}});
    const auto steps = PlanSteps({.tiles = 4}, SurveyToJson(survey), FilesOf(survey), reads, nullptr, failed);
    EXPECT_TRUE(steps.ok()) << steps.status();
    std::vector<std::string> found;
    for (const PlannedTask& task : *steps) {
      if (task.kind == kCropKind) found.push_back(task.name + " " + task.parameters + " " + std::to_string(task.tile));
    }
    return found;
  };
  const std::string all = R"(crop tiles 0 to 3 {"tiles":[0,1,2,3]} 0)";
  EXPECT_THAT(crops({}), ElementsAre(all));
  EXPECT_THAT(crops({{.tile = 0, .kind = kSolveKind, .step = 3}}), ElementsAre(all));
  EXPECT_THAT(crops({{.tile = 0, .kind = kMeasureKind, .step = 0}}), ElementsAre(all));
  EXPECT_THAT(crops({{.tile = 0, .kind = kCutKind}}, 3), ElementsAre(R"(crop tiles 1 to 3 {"tiles":[1,2,3]} 1)"));
  EXPECT_THAT(crops({{.tile = 0, .kind = kCropKind}}),
              ElementsAre(R"(crop tile 1 {"tiles":[1]} 1)", R"(crop tile 2 {"tiles":[2]} 2)",
                          R"(crop tile 3 {"tiles":[3]} 3)"));
}

TEST(Plan, MissingFileOfAViewIsNamed) {
  const Survey survey = RandomSurvey(3, 3, 1, 1);
  const auto refused = PlanTiles({.tiles = 1}, SurveyToJson(survey), {"images/0.jpg", "scene.json"});
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(refused.status().message(), "the scene has no file likelihoods/0.tif");
}

TEST(Plan, EqualSurveysGiveEqualPlans) {
  const Survey survey = RandomSurvey(20, 20, 0.8, 3);
  const auto a = PlanOf(survey, 7), b = PlanOf(survey, 7);
  ASSERT_EQ(a.size(), b.size());
  for (size_t t = 0; t < a.size(); ++t) {
    EXPECT_EQ(a[t].parameters, b[t].parameters);
    EXPECT_EQ(a[t].cost, b[t].cost);
  }
}

TEST(Plan, AllInvalidSettingsAreReported) {
  const auto refused = PlanIngest({.tiles = -1, .rounds = 1000, .method = "magic"}, {"scene.json"});
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
  const std::string message(refused.status().message());
  for (const char* word : {"tiles: found -1", "rounds: found 1000", "method: found \"magic\""}) {
    EXPECT_NE(message.find(word), std::string::npos) << message;
  }
  EXPECT_FALSE(PlanIngest({}, {}).ok());
  EXPECT_FALSE(PlanTiles({}, "not json", {"scene.json"}).ok());
}

// Parameters of the first task of a kind.
std::string ParametersOf(JobSettings settings, const std::string& kind) {
  const Survey survey = RandomSurvey(6, 6, 1, 1);
  settings.tiles = kind == "refine" ? 1 : 2;
  for (const PlannedTask& task : PlanOf(survey, settings, {{{0}, {0}, {0}, {0}}, {{1}, {1}, {1}, {1}}})) {
    if (task.kind == kind) return task.parameters;
  }
  ADD_FAILURE() << "no " << kind;
  return "";
}

TEST(Plan, RefineParametersContainMethodAndSettings) {
  for (const std::string kind : {"refine", "measure", "solve", "mend"}) {
    std::set<std::string> seen;
    for (const std::string method : kMethods) {
      if (method == kLabelsMethod) continue;  // below
      JobSettings settings;
      settings.method = method;
      EXPECT_TRUE(seen.insert(ParametersOf(settings, kind)).second) << method;
      settings.rounds = 2;
      EXPECT_TRUE(seen.insert(ParametersOf(settings, kind)).second) << method;
      settings.method_settings.thin_plate = 0.7;
      const std::string parameters = ParametersOf(settings, kind);
      EXPECT_TRUE(seen.insert(parameters).second) << method;
      const auto expect = [&](const auto& parsed) {
        ASSERT_TRUE(parsed.ok()) << parsed.status();
        EXPECT_EQ(parsed->method, method);
        EXPECT_EQ(parsed->rounds, 2);
        EXPECT_EQ(parsed->settings, settings.method_settings);
      };
      if (kind == "refine") {
        expect(ParseRefineParameters(parameters));
      } else {
        expect(ParseStepParameters(parameters));
      }
    }
    JobSettings unnamed, named;
    unnamed.method = "";
    EXPECT_EQ(ParametersOf(unnamed, kind), ParametersOf(named, kind));
  }
}

TEST(Plan, LabelsOnlyMethodHasOneStepAndNoRepair) {
  JobSettings settings = {.tiles = 2};
  settings.method = kLabelsMethod;
  Survey survey = RandomSurvey(6, 6, 1, 1);
  survey.has_likelihoods = true;
  survey.classes.resize(2);
  std::map<std::string, int> kinds;
  for (const PlannedTask& task : PlanOf(survey, settings, {{{0}, {0}, {0}, {0}}, {{1}, {1}, {1}, {1}}})) {
    ++kinds[task.kind];
  }
  EXPECT_EQ(kinds["measure"], 2);
  EXPECT_EQ(kinds["solve"], 2);
  EXPECT_EQ(kinds["mend"], 0);
  survey.has_likelihoods = false;
  EXPECT_EQ(PlanTiles(settings, SurveyToJson(survey), FilesOf(survey)).status().code(),
            absl::StatusCode::kInvalidArgument);
  settings.rounds = 2;
  settings.method_settings.contour = 1;
  const std::string refused(CheckJobSettings(settings).message());
  EXPECT_NE(refused.find("rounds: found 2, expected 1"), std::string::npos) << refused;
  EXPECT_NE(refused.find("method settings: found settings of the geometry"), std::string::npos) << refused;
}

}  // namespace
}  // namespace tessera
