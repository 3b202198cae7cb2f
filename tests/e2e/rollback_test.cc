// `tessera rollback` with the real executables.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::HasSubstr;

// A copy of the street without its first image.
void CopyWithoutAnImage(const std::string& to) {
  fs::copy(Street(), to, fs::copy_options::recursive);
  std::istringstream in(Content(to + "/colmap/images.txt"));
  std::ofstream out(to + "/colmap/images.txt");
  int dropped = 0;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("#")) continue;
    if (++dropped > 2) out << line << "\n";  // two lines an image
  }
}

// The command that a refusal suggests.
std::vector<std::string> CommandIn(const std::string& output) {
  const std::string program = "\n  tessera ";
  std::istringstream line(output.substr(output.find(program) + program.size()));
  std::vector<std::string> words;
  for (std::string word; line >> word;) words.push_back(word);
  return words;
}

// jobs/1; jobs/2 with a flight over the street's end; jobs/3 without that flight and without an image of its start, so
// that it redoes tiles of both.
class RollbackTest : public testing::Test {
 protected:
  RollbackTest() : folder_(TempFolder::Create(testing::TempDir()).value()) {
    CopyStreetResult(Path("1"));
    CopyWithoutAnImage(Path("fewer"));
    Run({"run", NextFlight(), "--base", Path("1"), "--out", Path("2")});
    Run({"run", Path("fewer"), "--base", Path("2"), "--out", Path("3")});
    fs::rename(Path("1/.tessera/data"), Path("data"));
    cluster_ = std::make_unique<Cluster>(folder_.path());
    cluster_->AddWorker();
  }

  std::string Path(const std::string& name) const { return folder_.path() + "/" + name; }
  Outcome Try(const std::vector<std::string>& arguments) { return Tessera(folder_.path(), arguments); }
  std::string Run(const std::vector<std::string>& arguments) {
    const Outcome outcome = Try(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    return outcome.output;
  }
  std::vector<std::string> At(std::vector<std::string> arguments) const {
    arguments.insert(arguments.end(), {"--coordinator", cluster_->address()});
    return arguments;
  }
  // The name of the job, once it has succeeded.
  std::string Finished(const std::vector<std::string>& arguments) {
    std::string name = Run(At(arguments));
    name.resize(name.find('\n'));
    const v1::Job job = cluster_->Await(name);
    EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error();
    return name;
  }
  // The mesh of each tile.
  static std::vector<std::string> Tiles(const std::string& out) {
    std::vector<std::string> meshes;
    const json index = json::parse(Content(out + "/tiles/index.json"));
    for (const json& tile : index["tiles"]) {
      meshes.push_back(Content(out + "/tiles/" + tile["file"].get<std::string>()));
    }
    return meshes;
  }

  TempFolder folder_;
  std::unique_ptr<Cluster> cluster_;
};

TEST_F(RollbackTest, RollbackIsExactAcrossSharedVertices) {
  const std::vector<std::string> first = Tiles(Path("1")), third = Tiles(Path("3"));
  std::set<int> differ;
  for (size_t t = 0; t < first.size(); ++t) {
    if (first[t] != third[t]) differ.insert(static_cast<int>(t));
  }
  ASSERT_GT(differ.size(), 1u);

  // What cannot be is refused.
  const auto expect = [&](const std::vector<std::string>& arguments, const std::string& words) {
    const Outcome outcome = Try(At(arguments));
    EXPECT_EQ(outcome.exit_code, 3);
    EXPECT_THAT(outcome.output, HasSubstr(words));
  };
  expect({"rollback", "1", "--to", "3"}, "found jobs/3, expected jobs/1 to have a base job");
  expect({"rollback", "3", "--to", "7"}, "found jobs/7, expected a base job of jobs/3: jobs/2, jobs/1");
  expect({"rollback", "3", "--to", "1", "--tile", "8"}, "found 8, expected one of the 8 tiles");
  EXPECT_THAT(Run(At({"rollback", "3", "--to", "1", "--validate-only"})), HasSubstr("jobs/1 can be restored"));
  EXPECT_EQ(Try(At({"watch", "jobs/4"})).exit_code, 3) << "nothing was accepted";

  // One tile, and those that the refusal names: a part of all that differ.
  const Outcome refused = Try(At({"rollback", "3", "--to", "1", "--tile", std::to_string(*differ.begin())}));
  EXPECT_EQ(refused.exit_code, 3);
  ASSERT_THAT(refused.output, HasSubstr("must be restored too"));
  std::vector<std::string> command = CommandIn(refused.output);
  const std::string back = Finished(command), out = cluster_->Fetch(back);
  const json rollback = json::parse(Content(out + "/job.json"))["rollback"];
  EXPECT_EQ(rollback["to"], "jobs/1");
  const auto gone_back = rollback["tiles"].get<std::set<int>>();
  EXPECT_LT(gone_back.size(), differ.size());
  const std::vector<std::string> tiles = Tiles(out);
  const std::string mesh = Content(out + "/mesh.ply");
  ASSERT_EQ(tiles.size(), first.size());
  for (size_t t = 0; t < tiles.size(); ++t) {
    EXPECT_TRUE(tiles[t] == (gone_back.contains(static_cast<int>(t)) ? first : third)[t]) << t;
  }
  EXPECT_EQ(json::parse(Content(out + "/report.json"))["seams"]["different"], 0);
  for (const v1::Task& task : cluster_->Tasks(back)) EXPECT_TRUE(task.kind() == "base" || task.kind() == "publish");

  // The same request gives the same job, and all tiles the first one's mesh.
  command.insert(command.end(), {"--request-id", "once"});
  const std::string once = Finished(command);
  EXPECT_EQ(Finished(command), once);
  const std::string all = Finished({"rollback", "jobs/3", "--to", "jobs/1"});
  EXPECT_TRUE(Content(cluster_->Fetch(all) + "/mesh.ply") == Content(Path("1/mesh.ply")));

  // Lineage tells of it, and an update goes on from it with the images of jobs/3.
  EXPECT_THAT(Run(At({"lineage", back, "--tile", std::to_string(*gone_back.begin())})),
              testing::AllOf(HasSubstr("made by jobs/1"), HasSubstr(": restored from jobs/1\n")));
  EXPECT_THAT(Run(At({"lineage", back, "--tile", std::to_string(*differ.rbegin())})),
              testing::AllOf(HasSubstr("made by jobs/3"), HasSubstr(": kept from jobs/3\n")));
  const v1::Job same = cluster_->Await(cluster_->Submit(Path("fewer"), 0, "", back).name());
  ASSERT_EQ(same.state(), v1::JOB_STATE_SUCCEEDED) << same.error();
  const std::string again = cluster_->Fetch(same.name());
  const json plan = json::parse(Content(again + "/update.json"));
  EXPECT_EQ(plan["tiles_redone"], 0) << plan["tiles"];
  EXPECT_TRUE(Content(again + "/mesh.ply") == mesh);
}

}  // namespace
}  // namespace tessera::e2e
