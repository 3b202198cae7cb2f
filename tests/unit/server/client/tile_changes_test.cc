#include "server/client/tile_changes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <utility>

#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

using nlohmann::json;

v1::Job JobWith(const std::string& name, const std::vector<std::pair<std::string, std::string>>& artifacts) {
  v1::Job job;
  job.set_name(name);
  for (const auto& [file, sha256] : artifacts) {
    v1::Artifact* const artifact = job.add_artifacts();
    artifact->set_name(file);
    artifact->mutable_digest()->set_sha256(sha256);
  }
  return job;
}

const v1::Job& Before() {
  static const v1::Job job = JobWith("jobs/1", {{"mesh.ply", "a"},
                                                {"report.json", "b"},
                                                {"tiles/0_0.ply", "c"},
                                                {"tiles/1_0.ply", "d"},
                                                {"tiles/2_0.ply", "e"},
                                                {"tiles/index.json", "f"}});
  return job;
}
const v1::Job& After() {
  static const v1::Job job = JobWith("jobs/2", {{"mesh.ply", "A"},
                                                {"report.json", "b"},
                                                {"tiles/0_0.ply", "c"},
                                                {"tiles/1_0.ply", "D"},
                                                {"tiles/3_0.ply", "g"},
                                                {"tiles/index.json", "f"},
                                                {"update.json", "h"}});
  return job;
}

TEST(TileChangesTest, ListsTileFilesOfBothJobs) {
  const json changes = json::parse(ChangesJson(Before(), After(), CompareTileFiles(Before(), After())));
  EXPECT_EQ(changes["job"], "jobs/2");
  EXPECT_EQ(changes["base"], "jobs/1");
  EXPECT_EQ(changes["changed"], 3);
  EXPECT_EQ(changes["tiles"],
            json::parse(R"([{"name": "tiles/0_0.ply", "old_sha256": "c", "new_sha256": "c", "changed": false},
                            {"name": "tiles/1_0.ply", "old_sha256": "d", "new_sha256": "D", "changed": true},
                            {"name": "tiles/2_0.ply", "old_sha256": "e", "new_sha256": null, "changed": true},
                            {"name": "tiles/3_0.ply", "old_sha256": null, "new_sha256": "g", "changed": true}])"));
}

TEST(TileChangesTest, FetchesChangedTilesAndJsonButNotTheWholeMesh) {
  std::vector<std::string> names;
  const v1::Job wanted = OnlyChanged(After(), CompareTileFiles(Before(), After()));
  for (const v1::Artifact& artifact : wanted.artifacts()) names.push_back(artifact.name());
  EXPECT_EQ(wanted.name(), "jobs/2");
  EXPECT_THAT(names, testing::UnorderedElementsAre("report.json", "tiles/1_0.ply", "tiles/3_0.ply", "tiles/index.json",
                                                   "update.json"));
}

TEST(TileChangesTest, JobEqualsItself) {
  const auto changes = CompareTileFiles(After(), After());
  EXPECT_EQ(changes.size(), 3u);
  for (const TileFileChange& change : changes) EXPECT_FALSE(change.changed()) << change.name;
}

}  // namespace
}  // namespace tessera
