// Updates: which tiles they refine, what they inherit from their base, which inputs their tasks have.
#include "server/plan/update_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "common/base/random.h"
#include "server/plan/graph.h"
#include "tests/unit/server/plan/update_pair.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

TEST(UpdatePlan, TilesAreRedoneIfTheViewsOfTheirCellsChange) {
  Pair pair(9);
  EXPECT_THAT(pair.Redone(), IsEmpty());
  const size_t cell = 17;
  const int32_t view = pair.AddView(cell);
  EXPECT_THAT(pair.Redone(), ElementsAre(pair.TileOf(cell)));
  const auto changes = *FindChangedTiles({}, pair.before, pair.now, pair.base.tiles, {});
  const TileChange& change = changes[pair.TileOf(cell)];
  ASSERT_EQ(change.why.size(), 1u);
  EXPECT_EQ(change.why[0].reason, ChangeReason::kImageSeen);
  EXPECT_THAT(change.why[0].views, ElementsAre(view));
  EXPECT_GT(change.predicted.core_seconds, 0);
}

TEST(UpdatePlan, EachReasonIsReported) {
  const auto reason = [](const std::function<void(Pair*, SurveyCell*)>& edit) {
    Pair pair(4);
    for (SurveyCell& cell : pair.now.cells) {
      if (cell.views.size() < 2) continue;
      edit(&pair, &cell);
      break;
    }
    std::set<ChangeReason> found;
    const auto changes = FindChangedTiles({}, pair.before, pair.now, pair.base.tiles, {});
    EXPECT_TRUE(changes.ok()) << changes.status();
    for (const TileChange& change : *changes) {
      for (const TileChange::Why& why : change.why) found.insert(why.reason);
    }
    return found;
  };
  using Reasons = std::set<ChangeReason>;
  EXPECT_EQ(reason([](Pair*, SurveyCell* cell) { cell->views.pop_back(); }), Reasons{ChangeReason::kImageSuperseded});
  EXPECT_EQ(reason([](Pair* pair, SurveyCell* cell) {
              pair->now.views[cell->views.back()].withdrawn = true;
              cell->views.pop_back();
            }),
            Reasons{ChangeReason::kImageWithdrawn});
  EXPECT_EQ(reason([](Pair* pair, SurveyCell* cell) { pair->now.views[cell->views[0]].image_content = "others"; }),
            Reasons{ChangeReason::kImageChanged});
  EXPECT_EQ(reason([](Pair* pair, SurveyCell* cell) {
              pair->now.views[cell->views[0]].camera.translation_cam_from_world.x() += 1;
            }),
            Reasons{ChangeReason::kPoseMoved});
  EXPECT_EQ(reason([](Pair* pair, SurveyCell* cell) { pair->now.views[cell->views[0]].lens.coefficients[0] = 0.1; }),
            Reasons{ChangeReason::kPoseMoved})
      << "a recalibrated lens";
  EXPECT_EQ(reason([](Pair* pair, SurveyCell*) {
              pair->now.scene_name = "another";
              for (SceneView& view : pair->now.views) view.name += "x";
              for (SceneView& view : pair->now.views) view.image_path = "elsewhere/" + view.image_path;
            }),
            Reasons{})
      << "a new name is no change";
  EXPECT_EQ(reason([](Pair* pair, SurveyCell* cell) {
              pair->now.revision = {1000, {{cell->x, cell->y}}};
            }),
            Reasons{ChangeReason::kMeshChanged});
}

TEST(UpdatePlan, FirstPhaseGivesOutputsOfTheBaseAndReadsNewFiles) {
  Pair pair(4);
  std::vector<NamedDigest> files;
  for (const NamedDigest& file : pair.base.scene_files) {
    if (file.name == "images/1.jpg") {
      files.push_back({CarriedName(file), file.digest});  // missing in the scene
    } else if (file.name == "images/2.jpg") {
      files.push_back({"renamed.jpg", file.digest});
    } else {
      files.push_back(file);
    }
  }
  files.push_back({"new.jpg", DigestOf("a new image")});
  std::sort(files.begin(), files.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
  pair.base.outdated = DigestOf("faces");
  const auto tasks = PlanUpdate({}, files, pair.base);
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  ASSERT_EQ(tasks->size(), 2u);
  const PlannedTask &taken = (*tasks)[0], &update = (*tasks)[1];
  EXPECT_EQ(taken.kind, kBaseKind);
  std::set<std::string> given;
  for (const NamedDigest& output : *taken.given) given.insert(output.name);
  EXPECT_EQ(given, (std::set<std::string>{kBaseSurveyFile, kCityFile, kOutdatedFile, "0000/state.arrays",
                                          "0001/state.arrays", "0002/state.arrays", "0003/state.arrays"}));
  ASSERT_EQ(taken.given_contents->size(), 1u);
  const auto told = ParseUpdateFiles(taken.given_contents->front().second);
  ASSERT_TRUE(told.ok());
  EXPECT_EQ(told->known.at("renamed.jpg").content, "pixels2");
  EXPECT_TRUE(told->known.at("mesh.ply").mesh);
  EXPECT_EQ(told->carried.at("images/2.jpg"), "renamed.jpg");
  EXPECT_TRUE(IsCarried(told->carried.at("images/1.jpg")));
  std::set<std::string> read;
  for (const int file : *update.scene_files) read.insert(files[file].name);
  EXPECT_EQ(read, (std::set<std::string>{"new.jpg", "scene.json"})) << "no image of the base, no mesh";
}

TEST(UpdatePlan, ManyNewImagesAreInspectedInParts) {
  Pair pair(4);
  std::vector<NamedDigest> files = pair.base.scene_files;
  for (int i = 0; i < 20; ++i) {
    const std::string name = "new/" + std::to_string(100 + i) + ".jpg";
    files.push_back({name, DigestOf(name)});
  }
  std::sort(files.begin(), files.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
  const auto tasks = PlanUpdate({}, files, pair.base);
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  ASSERT_EQ(tasks->size(), 4u);
  std::set<std::string> inspected;
  for (const int t : {1, 2}) {
    EXPECT_EQ((*tasks)[t].kind, kInspectKind);
    for (const int file : *(*tasks)[t].scene_files) inspected.insert(files[file].name);
    const PlannedInput& input = (*tasks)[3].inputs.at(2 + t);
    EXPECT_EQ(input.task, TaskId(t));
    EXPECT_EQ(InputName(input), TileInputName(t - 1, kInspectionFile));
  }
  EXPECT_EQ(inspected.size(), 21u) << "the new images and scene.json, none of the base";
  EXPECT_EQ((*tasks)[3].kind, kUpdateKind);
  // Later phases read the survey of the last task.
  pair.base.inspections = 2;
  const auto later = PlanTiles({}, SurveyToJson(pair.now), pair.Files(), &pair.base);
  ASSERT_TRUE(later.ok()) << later.status();
  std::set<int> read;
  for (const PlannedInput& input : later->back().inputs) read.insert(input.task.value());
  EXPECT_EQ(read, (std::set<int>{0, 3}));
}

TEST(UpdatePlan, WithoutChangesOnlyPublishIsPlannedWithTheBasesKey) {
  const Pair pair(4);
  const auto tasks = PlanTiles({}, SurveyToJson(pair.now), pair.Files(), &pair.base);
  ASSERT_TRUE(tasks.ok()) << tasks.status();
  ASSERT_EQ(tasks->size(), 2u);
  EXPECT_EQ((*tasks)[0].kind, kPlanKind);
  EXPECT_EQ((*tasks)[1].kind, kPublishKind);
  EXPECT_THAT((*tasks)[1].parameters, testing::Not(HasSubstr("kept")));
  for (const PlannedInput& input : (*tasks)[1].inputs) EXPECT_LT(input.task.value(), 2);
}

TEST(UpdatePlan, StepsFreezeKeptTiles) {
  Pair pair(4);
  const size_t cell = 3;
  const int redone = pair.TileOf(cell);
  pair.AddView(cell);
  const std::string survey = SurveyToJson(pair.now);
  const auto tiles = PlanTiles({}, survey, pair.Files(), &pair.base);
  ASSERT_TRUE(tiles.ok()) << tiles.status();
  ASSERT_EQ(tiles->size(), 2u) << "the plan and one cut";
  EXPECT_EQ((*tiles)[1].tile, redone);
  const std::vector<int> all = {0, 1, 2, 3};
  const auto steps = PlanSteps({}, survey, pair.Files(), {{all, all, all, all}}, &pair.base);
  ASSERT_TRUE(steps.ok()) << steps.status();
  std::vector<int> held = all;
  held.erase(held.begin() + redone);
  int solves = 0, compares = 0;
  std::set<int> levels;
  const std::vector<RefineStep> refine = RefineStepsOf("tessera", 0, {});
  for (const PlannedTask& task : *steps) {
    compares += task.kind == "compare";
    if (task.kind != "measure" && task.kind != "solve" && task.kind != "mend") continue;
    EXPECT_EQ(task.tile, redone);
    const auto parameters = ParseStepParameters(task.parameters);
    ASSERT_TRUE(parameters.ok()) << parameters.status();
    EXPECT_EQ(parameters->frozen, held);
    EXPECT_EQ(parameters->states, all);
    if (task.kind != "solve") continue;
    EXPECT_THAT(parameters->sums, ElementsAre(redone)) << "kept tiles have no sums";
    EXPECT_EQ(parameters->continues_base, solves == 0);
    levels.insert(refine[parameters->step].level);
    ++solves;
  }
  EXPECT_GT(solves, 2);
  EXPECT_EQ(levels, (std::set<int>{-1, 0, 1})) << "the two finest levels, and labels";
  EXPECT_GT(compares, 0);
  const auto publish = ParsePublishParameters(steps->back().parameters);
  ASSERT_TRUE(publish.ok());
  EXPECT_EQ(publish->kept, held);
  EXPECT_EQ(publish->tiles.size(), 4u);
  EXPECT_TRUE(publish->outdated);
  const PlannedTask& changes = (*steps)[steps->size() - 2];
  EXPECT_EQ(changes.kind, kChangesKind);
  EXPECT_EQ(InputName(steps->back().inputs.back()), kOutdatedFile);
  EXPECT_EQ(steps->back().inputs.back().task, TaskId(static_cast<int>(2 + tiles->size() + steps->size() - 2)));
  EXPECT_FALSE(ParseChangesParameters(changes.parameters)->outdated) << "the base has no outdated faces";
}

TEST(UpdatePlan, OutdatedFacesOfTheBaseAreInherited) {
  Pair pair(4);
  pair.base.outdated = DigestOf("faces");
  const auto same = PlanTiles({}, SurveyToJson(pair.now), pair.Files(), &pair.base);
  ASSERT_TRUE(same.ok()) << same.status();
  EXPECT_TRUE(ParsePublishParameters(same->back().parameters)->outdated);
  EXPECT_EQ(InputName(same->back().inputs.back()), kOutdatedFile);
  EXPECT_EQ(same->back().inputs.back().task, TaskId(0)) << "given, from the base";
  pair.AddView(3);
  const std::string survey = SurveyToJson(pair.now);
  const std::vector<int> all = {0, 1, 2, 3};
  const auto steps = PlanSteps({}, survey, pair.Files(), {{all, all, all, all}}, &pair.base);
  ASSERT_TRUE(steps.ok()) << steps.status();
  const PlannedTask& changes = (*steps)[steps->size() - 2];
  EXPECT_TRUE(ParseChangesParameters(changes.parameters)->outdated);
  EXPECT_EQ(InputName(changes.inputs.back()), kOutdatedFile);
  EXPECT_EQ(changes.inputs.back().task, TaskId(0));
  EXPECT_EQ(InputName(steps->back().inputs.back()), kOutdatedFile);
  EXPECT_GT(steps->back().inputs.back().task.value(), 0) << "from the update";
}

TEST(UpdatePlan, ChangedMeshIsReadFromTheUpdate) {
  Pair pair(4);
  const SurveyCell& cell = pair.now.cells[3];
  pair.now.revision = {1000, {{cell.x, cell.y}}};
  const int redone = pair.TileOf(3);
  const std::string survey = SurveyToJson(pair.now);
  const auto tiles = PlanTiles({}, survey, pair.Files(), &pair.base);
  ASSERT_TRUE(tiles.ok()) << tiles.status();
  ASSERT_EQ(tiles->size(), 2u) << "the plan and one cut";
  const std::vector<int> all = {0, 1, 2, 3};
  const auto steps = PlanSteps({}, survey, pair.Files(), {{all, all, all, all}}, &pair.base);
  ASSERT_TRUE(steps.ok()) << steps.status();
  std::set<int> levels;
  int begins = 0;
  const std::vector<RefineStep> refine = RefineStepsOf("tessera", 0, {});
  for (const std::vector<PlannedTask>* phase : {&*tiles, &*steps}) {
    for (const PlannedTask& task : *phase) {
      for (const PlannedInput& input : task.inputs) {
        if (input.output == kCityFile) {
          EXPECT_EQ(input.task.value(), 1) << task.name;
        }
        if (input.output == TileInputName(redone, kStateFile)) {
          EXPECT_EQ(task.kind, "mend") << "only mend may read states without the new faces";
        }
      }
      if (task.kind != "solve" && task.kind != "mend") continue;
      const auto parameters = ParseStepParameters(task.parameters);
      ASSERT_TRUE(parameters.ok()) << parameters.status();
      EXPECT_EQ(parameters->first_new_face, parameters->before ? 1000 : -1);
      EXPECT_EQ(parameters->continues_base, parameters->before);
      begins += parameters->before;
      if (task.kind == "solve") levels.insert(refine[parameters->step].level);
    }
  }
  EXPECT_EQ(begins, 1);
  EXPECT_EQ(levels, (std::set<int>{-1, 0, 1, 2}));
}

TEST(UpdatePlan, MeshOfTheBaseIsReadIfTheSceneMayHaveAnother) {
  Pair pair(4);
  for (const std::string& other : {std::string(), std::string("mesh.ply"), std::string("city.obj")}) {
    std::vector<NamedDigest> files;
    for (const NamedDigest& file : pair.base.scene_files) {
      if (file.name != "mesh.ply") files.push_back(file);
      if (file.name == "mesh.ply") files.push_back({CarriedName(file), file.digest});
    }
    if (!other.empty()) files.push_back({other, DigestOf("another mesh")});
    std::sort(files.begin(), files.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
    const auto tasks = PlanUpdate({}, files, pair.base);
    ASSERT_TRUE(tasks.ok()) << tasks.status();
    int meshes = 0;
    for (const int file : *(*tasks)[1].scene_files) {
      meshes += files[file].name == other || files[file].name.ends_with("mesh.ply");
    }
    EXPECT_EQ(meshes, other.empty() ? 0 : 2);
    EXPECT_TRUE(std::is_sorted((*tasks)[1].scene_files->begin(), (*tasks)[1].scene_files->end()));
  }
}

TEST(UpdatePlan, TilesGrowToNewCellsWithoutOverlap) {
  Random random(5);
  int gone = 0;
  for (int round = 0; round < 40; ++round) {
    Pair pair(9);
    pair.RemoveCellsOf(static_cast<int>(random.Below(9)));
    for (int i = 0; i < 12; ++i) {
      SurveyCell cell = pair.now.cells[0];
      cell.x = static_cast<int>(random.Below(24)) - 8;
      cell.y = static_cast<int>(random.Below(24)) - 8;
      pair.now.cells.push_back(cell);
      pair.now.revision->cells.push_back({cell.x, cell.y});
    }
    std::sort(pair.now.revision->cells.begin(), pair.now.revision->cells.end());
    const std::vector<TileParameters> tiles = TilesOfUpdate(pair.base.tiles, pair.now);
    for (const SurveyCell& cell : pair.now.cells) {
      EXPECT_EQ(std::count_if(tiles.begin(), tiles.end(),
                              [&](const TileParameters& tile) {
                                return tile.core.Contains({cell.x, cell.y});
                              }),
                1);
    }
    for (size_t t = 0; t < tiles.size(); ++t) {
      EXPECT_EQ(tiles[t].tile, static_cast<int>(t));
      const bool has_cells = std::any_of(pair.now.cells.begin(), pair.now.cells.end(), [&](const SurveyCell& cell) {
        return tiles[t].core.Contains({cell.x, cell.y});
      });
      EXPECT_EQ(tiles[t].core.empty(), !has_cells);
      gone += tiles[t].core.empty();
    }
  }
  EXPECT_GT(gone, 0);
}

TEST(UpdatePlan, RemovedTileHasNoTasksAndNoState) {
  constexpr int kGone = 4;  // in the middle
  Pair pair(9);
  pair.RemoveCellsOf(kGone);
  size_t beside = 0;
  while (DistanceBetween({pair.now.cells[beside].x, pair.now.cells[beside].y, pair.now.cells[beside].x + 1,
                          pair.now.cells[beside].y + 1},
                         pair.base.tiles[kGone].core, 1) > 0) {
    ++beside;
  }
  pair.AddView(beside);
  const int redone = pair.TileOf(beside);
  const std::string survey = SurveyToJson(pair.now);
  std::vector<int> left = {0, 1, 2, 3, 5, 6, 7, 8}, kept = left;
  std::erase(kept, redone);
  const auto tiles = PlanTiles({}, survey, pair.Files(), &pair.base);
  ASSERT_TRUE(tiles.ok()) << tiles.status();
  ASSERT_EQ(tiles->size(), 2u) << "the plan and one cut";
  EXPECT_TRUE(ParseCutParameters((*tiles)[1].parameters)->cores[kGone].empty());
  const auto plan = nlohmann::json::parse((*tiles)[0].given_contents->front().second);
  EXPECT_EQ(plan["tiles_gone"], nlohmann::json::array({kGone}));
  EXPECT_EQ(plan["tiles"].size(), left.size());
  const auto steps = PlanSteps({}, survey, pair.Files(), {{left, left, left, left}}, &pair.base);
  ASSERT_TRUE(steps.ok()) << steps.status();
  int before = 0;
  for (const PlannedTask& task : *steps) {
    EXPECT_NE(task.tile, kGone) << task.name;
    const bool compares = task.kind == "compare";
    for (const PlannedInput& input : task.inputs) {
      const bool of_gone = InputName(input) == TileInputName(kGone, kStateFile);
      EXPECT_TRUE(!of_gone || compares) << task.name << " reads the removed tile";
      before += of_gone;
    }
  }
  EXPECT_GT(before, 0) << "the old surface is compared with the new images";
  const auto publish = ParsePublishParameters(steps->back().parameters);
  ASSERT_TRUE(publish.ok());
  ASSERT_EQ(publish->tiles.size(), 9u) << "tiles keep their numbers";
  for (int t = 0; t < 9; ++t) {
    EXPECT_EQ(publish->tiles[t].tile, t);
    EXPECT_EQ(publish->tiles[t].core.empty(), t == kGone);
  }
  EXPECT_EQ(publish->kept, kept);
  // An update of this update only has the tile's number.
  pair.before = pair.now;
  pair.now.revision.reset();
  pair.base.survey_json = SurveyToJson(pair.before);
  pair.base.tiles = publish->tiles;
  pair.base.states[kGone] = {};
  const auto given = PlanUpdate({}, pair.base.scene_files, pair.base);
  ASSERT_TRUE(given.ok()) << given.status();
  for (const NamedDigest& output : *(*given)[0].given) EXPECT_NE(output.name, TileInputName(kGone, kStateFile));
  const auto next = PlanTiles({}, SurveyToJson(pair.now), pair.Files(), &pair.base);
  ASSERT_TRUE(next.ok()) << next.status();
  EXPECT_EQ(next->back().kind, kPublishKind);
  EXPECT_EQ(ParsePublishParameters(next->back().parameters)->tiles.size(), 9u);
  EXPECT_EQ(nlohmann::json::parse((*next)[0].given_contents->front().second)["tiles_gone"], nlohmann::json::array());
}

TEST(UpdatePlan, FromScratchRefinesAllTilesAndFreezesNone) {
  Pair pair(4);
  pair.AddView(3);
  JobSettings settings;
  settings.update.base = "jobs/1";
  settings.update.from_scratch = true;
  const auto tiles = PlanTiles(settings, SurveyToJson(pair.now), pair.Files(), &pair.base);
  ASSERT_TRUE(tiles.ok()) << tiles.status();
  EXPECT_EQ(tiles->size(), 5u) << "the plan and all cuts";
  const auto plan = nlohmann::json::parse((*tiles)[0].given_contents->front().second);
  EXPECT_EQ(plan["predicted"]["core_seconds"], plan["predicted"]["core_seconds_in_full"]) << "upper bound";
  EXPECT_EQ(plan["predicted"]["stored_bytes"], plan["predicted"]["stored_bytes_in_full"]) << "upper bound";
  EXPECT_GT(plan["predicted"]["stored_bytes"], 0);
  for (const auto& tile : plan["tiles"]) {
    if (tile["tile"] == pair.TileOf(3)) {
      EXPECT_EQ(tile["redone"], true);
    } else {
      EXPECT_TRUE(tile["redone"].is_null()) << "not known before the cuts";
    }
  }
}

TEST(UpdatePlan, MeasuredCostsCorrectPredictionsOnly) {
  Pair pair(4);
  pair.AddView(3);
  const std::string survey = SurveyToJson(pair.now);
  const std::vector<int> all = {0, 1, 2, 3};
  const auto plan = [&] {
    std::vector<PlannedTask> tasks = *PlanTiles({}, survey, pair.Files(), &pair.base);
    const std::vector<PlannedTask> steps = *PlanSteps({}, survey, pair.Files(), {{all, all, all, all}}, &pair.base);
    tasks.insert(tasks.end(), steps.begin(), steps.end());
    return tasks;
  };
  const std::vector<PlannedTask> before = plan();
  pair.base.measured = {{"measure", {100, 50}}, {"mend", {10, 20}}, {kIngestKind, {1000, 30}}};
  // For ingest, use the model's prediction from the survey instead of the planned cost.
  const double ingest = 30 / PredictIngest(pair.before).core_seconds;
  const double others = 100 / (110 + PredictIngest(pair.before).core_seconds);
  const std::vector<PlannedTask> after = plan();
  ASSERT_EQ(after.size(), before.size());
  std::set<std::string> kinds;
  for (size_t t = 1; t < after.size(); ++t) {
    kinds.insert(after[t].kind);
    const double factor = after[t].kind == "measure" ? 0.5 : after[t].kind == "mend" ? 2 : others;
    EXPECT_NEAR(after[t].cost, factor * before[t].cost, 1e-9 * before[t].cost) << after[t].name;
    EXPECT_EQ(after[t].scale, factor) << after[t].name;
    EXPECT_EQ(after[t].peak_bytes, before[t].peak_bytes);
    EXPECT_EQ(after[t].parameters, before[t].parameters) << "keys do not depend on predictions";
  }
  EXPECT_TRUE(kinds.contains("measure") && kinds.contains("mend") && kinds.contains("compare"));
  const auto was = nlohmann::json::parse(before[0].given_contents->front().second)["predicted"];
  const auto now = nlohmann::json::parse(after[0].given_contents->front().second)["predicted"];
  EXPECT_NEAR(now["ingest"]["core_seconds"],
              was["ingest"]["core_seconds"].get<double>() * std::clamp(ingest, kLeastScale, kMostScale), 1e-9);
  EXPECT_NEAR(now["publish"]["core_seconds"], was["publish"]["core_seconds"].get<double>() * others, 1e-9);
  double sum = now["ingest"]["core_seconds"];
  for (size_t t = 1; t < after.size(); ++t) sum += after[t].cost;
  EXPECT_NEAR(now["core_seconds"], sum, 1e-6 * sum) << "the plan contains the sum over its tasks";
}

TEST(UpdatePlan, JobAboveThePriceLimitIsRefused) {
  Pair pair(4);
  pair.AddView(3);
  JobSettings settings;
  settings.max_core_seconds = 1e-3;
  for (const UpdateBase* base : {static_cast<const UpdateBase*>(&pair.base), static_cast<const UpdateBase*>(nullptr)}) {
    const auto refused = PlanTiles(settings, SurveyToJson(pair.now), pair.Files(), base);
    EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(refused.status().message(), HasSubstr("more than the limit of 0.001"));
  }
}

TEST(UpdatePlan, SurveyWithOtherCellsIsRefused) {
  Pair pair(4);
  pair.now.cells.pop_back();
  EXPECT_FALSE(FindChangedTiles({}, pair.before, pair.now, pair.base.tiles, {}).ok());
  pair.now = pair.before;
  pair.now.cells[0].x += 1000;
  EXPECT_FALSE(FindChangedTiles({}, pair.before, pair.now, pair.base.tiles, {}).ok());
}

}  // namespace
}  // namespace tessera
