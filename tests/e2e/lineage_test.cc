// `tessera lineage` and `fetch --changed-since` after an update, with the real executables.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "common/base/version.h"
#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

// The last state of each tile among the outputs of a job's tasks.
std::map<int, std::string> StatesIn(const std::string& job_json) {
  std::map<int, std::string> states;
  const json job = json::parse(Content(job_json));
  for (const json& task : job["tasks"]) {
    if (task["outputs"].contains("state.arrays")) states[task["tile"]] = task["outputs"]["state.arrays"]["sha256"];
  }
  return states;
}

std::set<std::string> FilesIn(const std::string& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) names.insert(fs::relative(entry.path(), folder));
  }
  return names;
}

// A job and its update, asked in the folders that `tessera run` left and at a coordinator with their state.
TEST(LineageTest, LineageOfUpdateNamesRefinedTilesAndImages) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  const std::string base = folder.path() + "/base", next = folder.path() + "/next";
  CopyStreetResult(base);
  const auto tessera = [&](const std::vector<std::string>& arguments) {
    const Outcome outcome = Tessera(folder.path(), arguments);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    return outcome.output;
  };
  tessera({"run", NextFlight(), "--base", base, "--out", next});
  const json update = json::parse(Content(next + "/update.json"));
  EXPECT_EQ(json::parse(Content(next + "/job.json"))["base"], "jobs/1");
  std::map<int, std::string> states_of_base = StatesIn(base + "/job.json"),
                             states_of_next = StatesIn(next + "/job.json");

  const json lineage = json::parse(tessera({"lineage", next, "--json"}));
  ASSERT_EQ(lineage["tiles"].size(), update["tiles"].size());
  EXPECT_EQ(lineage["chain"][0]["algorithm_version"], kAlgorithmVersion);
  int kept = -1, redone = -1;
  for (size_t t = 0; t < lineage["tiles"].size(); ++t) {
    SCOPED_TRACE("tile " + std::to_string(t));
    const json &tile = lineage["tiles"][t], &plan = update["tiles"][t];
    const bool is_new = plan["redone"];
    (is_new ? redone : kept) = static_cast<int>(t);
    EXPECT_EQ(tile["core"], plan["core"]);
    EXPECT_EQ(tile["made_by"], is_new ? "jobs/2" : "jobs/1");
    EXPECT_EQ(tile["state_sha256"], (is_new ? states_of_next : states_of_base)[static_cast<int>(t)]);
    // The images that came are those that the cells chose; a tile that was kept has none of them.
    std::set<std::string> came, of_next;
    for (const json& why : plan["why"]) {
      if (why["reason"] == "image seen") came = why["images"];
    }
    for (const json& flight : tile["flights"]) {
      if (flight["flight"] == "next") of_next = flight["images"];
    }
    EXPECT_EQ(of_next, came);
  }
  ASSERT_TRUE(kept >= 0 && redone >= 0) << update;

  EXPECT_THAT(tessera({"lineage", next, "--tile", std::to_string(kept)}),
              AllOf(HasSubstr("made by jobs/1"), HasSubstr("kept from jobs/1"), Not(HasSubstr("redone"))));
  const std::string image = update["tiles"][redone]["why"][0]["images"][0];
  EXPECT_THAT(tessera({"lineage", next, "--tile", std::to_string(redone), "--images"}),
              AllOf(HasSubstr("made by jobs/2"), HasSubstr("redone from jobs/1 because: image seen"),
                    HasSubstr("\n  " + image + "\n")));

  fs::rename(base + "/.tessera/data", folder.path() + "/data");
  const Cluster cluster(folder.path());
  const std::string part = folder.path() + "/part";
  const auto at = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--coordinator", cluster.address()});
    return tessera(arguments);
  };
  EXPECT_EQ(json::parse(at({"lineage", "jobs/2", "--json"})), lineage);
  EXPECT_THAT(at({"fetch", "jobs/2", "--changed-since", "jobs/1", "--out", part}),
              HasSubstr(" of 8 tile meshes changed since jobs/1"));
  std::set<std::string> expected = {"changed.json", "changes.json",     "job.json",
                                    "report.json",  "tiles/index.json", "update.json"};
  const json changes = json::parse(Content(part + "/changed.json"));
  EXPECT_EQ(changes["tiles"].size(), 8u);
  for (const json& tile : changes["tiles"]) {
    const std::string name = tile["name"];
    const bool changed = Content(base + "/" + name) != Content(next + "/" + name);
    EXPECT_EQ(tile["changed"], changed) << name;
    EXPECT_EQ(tile["old_sha256"] != tile["new_sha256"], changed) << name;
    if (changed) expected.insert(name);
  }
  EXPECT_EQ(FilesIn(part), expected);
  for (const std::string& name : expected) {
    if (name != "changed.json") {
      EXPECT_TRUE(Content(part + "/" + name) == Content(next + "/" + name)) << name;
    }
  }
  EXPECT_LT(expected.size(), 5u + 8u);
}

}  // namespace
}  // namespace tessera::e2e
