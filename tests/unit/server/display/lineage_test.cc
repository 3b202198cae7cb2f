#include "server/client/lineage.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "server/display/lineage_text.h"

namespace tessera {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

json Output(const std::string& sha256) { return {{"sha256", sha256}, {"size_bytes", 1}}; }

// job.json of a job of three tiles beside each other. `base`: empty for a first job; `states`: by tile, those that its
// own tasks left, one after the other; `inherited`: by tile, those of its base.
json JobReport(const std::string& name, const std::string& base, const std::map<int, std::vector<std::string>>& states,
               const std::map<int, std::string>& inherited = {}) {
  json tasks = json::array();
  if (!base.empty()) {
    json given;
    for (const auto& [tile, sha256] : inherited) given[TileInputName(tile, kStateFile)] = Output(sha256);
    tasks.push_back({{"kind", "base"}, {"tile", -1}, {"outputs", given}});
  }
  tasks.push_back({{"kind", base.empty() ? "ingest" : "update"},
                   {"tile", -1},
                   {"outputs", {{kSurveyFile, Output("survey of " + name)}}}});
  for (const auto& [tile, of_tile] : states) {
    tasks.push_back({{"kind", "measure"}, {"tile", tile}, {"outputs", {{kSumsFile, Output("sums")}}}});
    for (const std::string& sha256 : of_tile) {
      tasks.push_back({{"kind", "solve"}, {"tile", tile}, {"outputs", {{kStateFile, Output(sha256)}}}});
    }
  }
  PublishParameters parameters;
  for (int t = 0; t < 3; ++t) parameters.tiles.push_back({t, {4 * t, 0, 4 * t + 4, 4}});
  tasks.push_back({{"kind", "publish"},
                   {"tile", -1},
                   {"parameters", json::parse(ToJson(parameters))},
                   {"outputs", {{kMeshFile, Output("mesh")}}}});
  return {{"name", name},
          {"display_name", "city"},
          {"algorithm_version", "7"},
          {"base", base.empty() ? json() : json(base)},
          {"settings", {{"method", "tessera"}, {"method_settings", json::object()}}},
          {"tasks", tasks}};
}

std::string UpdateOf(int tile, const std::string& reason) {
  json tiles = json::array();
  for (int t = 0; t < 3; ++t) {
    json why = json::array();
    if (t == tile) why.push_back({{"reason", reason}, {"images", {"new/1.jpg", "new/2.jpg"}}});
    tiles.push_back({{"tile", t}, {"why", why}});
  }
  return json{{"tiles", tiles}}.dump();
}

LineageJob Parsed(const json& report, const std::string& update = "") {
  const auto job = ParseLineageJob(report.dump(), update);
  EXPECT_TRUE(job.ok()) << job.status();
  return job.ok() ? *job : LineageJob();
}

// Tile 0 is of the first job, 1 of the second, 2 of the third, though the second had redone it too.
std::vector<LineageJob> Chain() {
  const json first = JobReport("jobs/1", "", {{0, {"a", "b"}}, {1, {"c"}}, {2, {"d"}}});
  const json second = JobReport("jobs/4", "jobs/1", {{1, {"e", "f"}}, {2, {"g"}}}, {{0, "b"}, {1, "c"}, {2, "d"}});
  const json third = JobReport("jobs/5", "jobs/4", {{2, {"h"}}}, {{0, "b"}, {1, "f"}, {2, "g"}});
  return {Parsed(third, UpdateOf(2, "image seen")), Parsed(second, UpdateOf(1, "image withdrawn")), Parsed(first)};
}

TEST(LineageTest, ParsesRefinedAndInheritedTiles) {
  const LineageJob job = Chain()[1];
  EXPECT_EQ(job.name, "jobs/4");
  EXPECT_EQ(job.base, "jobs/1");
  EXPECT_EQ(job.algorithm_version, "7");
  EXPECT_EQ(job.method, "tessera");
  EXPECT_EQ(job.survey.sha256, "survey of jobs/4");
  EXPECT_EQ(job.made.at(1).sha256, "f") << "the last state";
  EXPECT_FALSE(job.made.contains(0));
  EXPECT_EQ(job.inherited.at(0).sha256, "b");
  EXPECT_EQ(job.tiles.size(), 3u);
  EXPECT_EQ(job.redos.size(), 1u);
  EXPECT_THAT(job.redos.at(1).front().images, ElementsAre("new/1.jpg", "new/2.jpg"));
}

TEST(LineageTest, TileBelongsToTheNewestJobWithTasksForIt) {
  const auto lineage = TraceTiles(Chain());
  ASSERT_TRUE(lineage.ok()) << lineage.status();
  std::vector<std::string> makers, states;
  for (const TileLineage& tile : lineage->tiles) {
    makers.push_back(lineage->chain[tile.made_by].name);
    states.push_back(tile.state.sha256);
  }
  EXPECT_THAT(makers, ElementsAre("jobs/1", "jobs/4", "jobs/5"));
  EXPECT_THAT(states, ElementsAre("b", "f", "h"));
}

TEST(LineageTest, RestoredTileBelongsToTheEarlierJob) {
  json back = JobReport("jobs/6", "jobs/5", {}, {{0, "b"}, {1, "c"}, {2, "h"}});
  back["rollback"] = {{"to", "jobs/1"}, {"tiles", {1}}};
  std::vector<LineageJob> chain = Chain();
  chain.insert(chain.begin(), Parsed(back));
  const auto lineage = TraceTiles(chain);
  ASSERT_TRUE(lineage.ok()) << lineage.status();
  EXPECT_EQ(lineage->chain[lineage->tiles[1].made_by].name, "jobs/1");
  EXPECT_EQ(lineage->tiles[1].state.sha256, "c");
  EXPECT_EQ(lineage->chain[lineage->tiles[2].made_by].name, "jobs/5");
  EXPECT_THAT(*TileLineageText(*lineage, 1, false), HasSubstr("jobs/6 (city): restored from jobs/1\n"));
  EXPECT_THAT(*TileLineageText(*lineage, 2, false), HasSubstr("jobs/6 (city): kept from jobs/5\n"));
  const json told = json::parse(*LineageJson(*lineage, 1))["tiles"][0]["history"][0];
  EXPECT_EQ(told["did"], "rolled back");
  EXPECT_EQ(told["to"], "jobs/1");
  chain[0].inherited[1].sha256 = "f";
  EXPECT_EQ(TraceTiles(chain).status().code(), absl::StatusCode::kDataLoss) << "not what jobs/1 left";
}

TEST(LineageTest, InheritedStateThatDiffersFromTheBaseIsAnError) {
  std::vector<LineageJob> chain = Chain();
  chain[1].inherited[0].sha256 = "x";
  const Status status = TraceTiles(chain).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(status.message()), AllOf(HasSubstr("jobs/5"), HasSubstr("tile 0")));
  chain.pop_back();
  chain[1].inherited[0].sha256 = "b";
  EXPECT_THAT(std::string(TraceTiles(chain).status().message()), HasSubstr("has no base"));
}

TEST(LineageTest, MalformedReportsAreRefused) {
  EXPECT_EQ(ParseLineageJob("{}", "").status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(ParseLineageJob("", "").status().code(), absl::StatusCode::kDataLoss);
  json plan_only = JobReport("jobs/3", "jobs/1", {});
  plan_only["tasks"].erase(plan_only["tasks"].size() - 1);
  EXPECT_EQ(ParseLineageJob(plan_only.dump(), "").status().code(), absl::StatusCode::kFailedPrecondition);
  json strange = JobReport("jobs/1", "", {});
  strange["tasks"][0]["outputs"][kSurveyFile] = 5;
  EXPECT_EQ(ParseLineageJob(strange.dump(), "").status().code(), absl::StatusCode::kDataLoss);
}

Survey SmallSurvey() {
  Survey survey;
  survey.flights = {{"spring", "2026-05-14"}, {"next", ""}};
  for (const auto& [name, flight] : {std::pair("b.jpg", 0), std::pair("a.jpg", 0), std::pair("n.jpg", 1)}) {
    SceneView& view = survey.views.emplace_back();
    view.name = name;
    view.flight = flight;
  }
  for (int x = 0; x < 12; ++x) {
    SurveyCell& cell = survey.cells.emplace_back();
    cell.x = x;
    cell.views = x < 4 ? std::vector<int32_t>{0, 1} : x < 8 ? std::vector<int32_t>{1, 2} : std::vector<int32_t>{2};
  }
  return survey;
}

TEST(LineageTest, ImagesAreThoseOfTheCoreCells) {
  const Survey survey = SmallSurvey();
  const auto first = ImagesOfTile(survey, {0, 0, 4, 4});
  ASSERT_EQ(first.size(), 1u);
  EXPECT_EQ(first[0].flight, "spring");
  EXPECT_EQ(first[0].date, "2026-05-14");
  EXPECT_THAT(first[0].images, ElementsAre("a.jpg", "b.jpg"));
  const auto second = ImagesOfTile(survey, {4, 0, 8, 4});
  ASSERT_EQ(second.size(), 2u);
  EXPECT_THAT(second[0].images, ElementsAre("a.jpg"));
  EXPECT_THAT(second[1].images, ElementsAre("n.jpg"));
}

TEST(LineageTest, ImagesComeFromTheSurveyOfTheRefiningJob) {
  std::vector<std::string> asked;
  const auto read = [&](const Digest& digest) -> StatusOr<std::string> {
    asked.push_back(digest.sha256);
    if (digest.sha256 == "survey of jobs/5") return absl::NotFoundError("gone");
    Survey survey = SmallSurvey();
    survey.gsd_m = survey.ground.cell_m = 1;
    survey.view_depths.resize(survey.views.size());
    survey.flights[0].name = digest.sha256;
    return SurveyToJson(survey);
  };
  Lineage all = *TraceTiles(Chain()), one = all;
  ASSERT_TRUE(FillImages(read, -1, &all).ok());
  EXPECT_THAT(asked, testing::UnorderedElementsAre("survey of jobs/1", "survey of jobs/4", "survey of jobs/5"));
  ASSERT_TRUE(all.tiles[0].images.has_value() && all.tiles[1].images.has_value());
  EXPECT_EQ(all.tiles[0].images->front().flight, "survey of jobs/1");
  EXPECT_EQ(all.tiles[1].images->front().flight, "survey of jobs/4");
  EXPECT_FALSE(all.tiles[2].images.has_value());
  asked.clear();
  ASSERT_TRUE(FillImages(read, 1, &one).ok());
  EXPECT_THAT(asked, ElementsAre("survey of jobs/4"));
  EXPECT_TRUE(one.tiles[1].images.has_value());
}

Lineage SmallLineage() {
  Lineage lineage = *TraceTiles(Chain());
  lineage.chain[1].finished_s = 1'800'000'000;  // 2027-01-15 08:00:00 UTC
  for (TileLineage& tile : lineage.tiles) tile.images = ImagesOfTile(SmallSurvey(), tile.tile.core);
  lineage.tiles[2].images.reset();
  return lineage;
}

TEST(LineageTextTest, TableHasOneLinePerTile) {
  const std::string table = LineageTable(SmallLineage());
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 4);
  EXPECT_THAT(table, HasSubstr("1     4,0..8,4   jobs/4 (city)  2027-01-15  7        tessera  spring 1, next 1  f\n"));
  EXPECT_THAT(table, HasSubstr("not stored"));
}

TEST(LineageTextTest, TileTextHasHistoryReasonsAndImages) {
  const Lineage lineage = SmallLineage();
  const auto text = TileLineageText(lineage, 1, false);
  ASSERT_TRUE(text.ok()) << text.status();
  EXPECT_THAT(*text,
              AllOf(HasSubstr("made by jobs/4 (city), finished 2027-01-15 08:00:00 UTC"),
                    HasSubstr("   jobs/5 (city): kept from jobs/4\n"
                              "<- jobs/4 (city): redone from jobs/1 because: image withdrawn: 2 (new/1.jpg, ...)\n"
                              "<- jobs/1 (city): made from the start mesh\n")));
  EXPECT_THAT(*text, testing::Not(HasSubstr("n.jpg")));
  EXPECT_THAT(*TileLineageText(lineage, 1, true),
              HasSubstr("flight spring, 2026-05-14\n  a.jpg\nflight next\n  n.jpg\n"));
  EXPECT_EQ(TileLineageText(lineage, 3, false).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(LineageTextTest, JsonMatchesTheText) {
  const Lineage lineage = SmallLineage();
  const json all = json::parse(*LineageJson(lineage, -1)), one = json::parse(*LineageJson(lineage, 1));
  EXPECT_EQ(all["tiles"].size(), 3u);
  EXPECT_EQ(all["chain"].size(), 3u);
  EXPECT_EQ(one["tiles"], json::array({all["tiles"][1]}));
  const json& tile = all["tiles"][1];
  EXPECT_EQ(tile["made_by"], "jobs/4");
  EXPECT_EQ(tile["state_sha256"], "f");
  EXPECT_EQ(tile["flights"][1]["images"], json::array({"n.jpg"}));
  EXPECT_EQ(tile["history"][0]["did"], "kept");
  EXPECT_EQ(tile["history"][1]["why"][0]["reason"], "image withdrawn");
  EXPECT_EQ(tile["history"][2]["did"], "made");
  EXPECT_TRUE(all["tiles"][2]["flights"].is_null());
  EXPECT_EQ(all["chain"][1]["finished"], "2027-01-15T08:00:00Z");
  EXPECT_EQ(LineageJson(lineage, 3).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace tessera
