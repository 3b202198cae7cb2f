#include "server/fleet/fleet_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr char kFile[] = R"({
  "name": "city", "scheduler": "slurm", "pilot": "/opt/pilot", "worker": ["w", "--coordinator", "login:7575"],
  "options": ["--qos=low"], "logs": "/scratch/logs", "worth_s": 200, "interval_s": 20, "command_s": 30,
  "classes": [
    {"name": "large", "memory": "16GiB", "cores": 4, "time_limit_s": 14450, "most": 4, "options": ["-p", "fat"]},
    {"name": "small", "memory": 2147483648, "time_limit_s": 3600, "least": 1, "most": 20, "most_pending": 5}]})";

TEST(FleetFileTest, AllFieldsAreRead) {
  const auto fleet = ParseFleetFile("f.json", kFile);
  ASSERT_TRUE(fleet.ok()) << fleet.status();
  EXPECT_EQ(fleet->name, "city");
  EXPECT_EQ(fleet->worth_s, 200);
  EXPECT_EQ(fleet->interval_s, 20);
  EXPECT_EQ(fleet->command_s, 30);
  ASSERT_EQ(fleet->classes.size(), 2u);
  const PilotClass& small = fleet->classes[0];
  EXPECT_EQ(small.name, "small") << "classes are sorted by memory";
  EXPECT_EQ(small.memory_mib, 2048);
  EXPECT_EQ(small.cores, 1);
  EXPECT_EQ(small.least, 1);
  EXPECT_EQ(small.most, 20);
  EXPECT_EQ(small.most_pending, 5);
  const PilotClass& large = fleet->classes[1];
  EXPECT_EQ(large.memory_mib, 16384);
  EXPECT_EQ(large.cores, 4);
  EXPECT_EQ(large.time_limit_s, 14450);
  EXPECT_EQ(large.most_pending, 4) << "as many as `most`";
  EXPECT_EQ(JobName(*fleet, large), "tessera.city.large");
}

TEST(FleetFileTest, SlurmCommandsHaveTheirWords) {
  const auto fleet = ParseFleetFile("f.json", kFile);
  ASSERT_TRUE(fleet.ok()) << fleet.status();
  EXPECT_THAT(SubmitWords(*fleet, fleet->classes[1], 3),
              ElementsAre("sbatch", "--parsable", "--array=1-3", "--job-name=tessera.city.large", "--nodes=1",
                          "--ntasks=1", "--cpus-per-task=4", "--mem=16384M", "--time=240",
                          "--output=/scratch/logs/%x-%A_%a.out", "--open-mode=append", "--no-requeue", "--qos=low",
                          "-p", "fat", "/opt/pilot", "w", "--coordinator", "login:7575"));
  EXPECT_THAT(ListWords(*fleet, "1000"), ElementsAre("squeue", "--json", "--states=all", "--user=1000",
                                                     "--name=tessera.city.small,tessera.city.large"));
  EXPECT_THAT(CancelWords(*fleet, {"17_3", "17_4"}), ElementsAre("scancel", "--state=PENDING", "17_3", "17_4"));
}

TEST(FleetFileTest, OtherSchedulersHaveTheirOwnCommands) {
  const auto fleet = ParseFleetFile("f.json", R"({
    "name": "city", "scheduler": {"submit": ["q", "{job}:{count}", "{x}{memory_mib}", "{worker}"],
                                  "list": ["qs", "{name}"], "cancel": ["qd", "{jobs}"]},
    "classes": [{"name": "a", "memory": "1GiB", "time_limit_s": 60, "most": 1}]})");
  EXPECT_THAT(fleet.status().ToString(), HasSubstr("scheduler.submit"));
  EXPECT_THAT(fleet.status().ToString(), HasSubstr("{x}{memory_mib}"));
  const auto right = ParseFleetFile("f.json", R"({
    "name": "city", "scheduler": {"submit": ["q", "{job}:{count}", "{worker}"],
                                  "list": ["qs", "{name}"], "cancel": ["qd", "{jobs}"]},
    "classes": [{"name": "a", "memory": "1GiB", "time_limit_s": 60, "most": 1}]})");
  ASSERT_TRUE(right.ok()) << right.status();
  EXPECT_FALSE(right->commands.lists_as_squeue);
  EXPECT_THAT(SubmitWords(*right, right->classes[0], 1), ElementsAre("q", "tessera.city.a:1", "tessera-worker"));
  EXPECT_THAT(CancelWords(*right, {}), ElementsAre("qd"));
}

// A value with a placeholder in it is not replaced again.
TEST(FleetFileTest, ValuesAreNotReplacedAgain) {
  auto fleet = ParseFleetFile("f.json", kFile);
  ASSERT_TRUE(fleet.ok()) << fleet.status();
  fleet->pilot = "/{count}";
  EXPECT_THAT(SubmitWords(*fleet, fleet->classes[0], 7), testing::Contains("/{count}"));
}

struct WrongFile {
  const char* pointer;  // to the changed value
  const char* value;
  const char* place;
  const char* expected;
};

class WrongFileTest : public testing::TestWithParam<WrongFile> {};

TEST_P(WrongFileTest, NamesTheFaultAndItsPlace) {
  auto json = nlohmann::json::parse(kFile);
  json[nlohmann::json::json_pointer(GetParam().pointer)] = nlohmann::json::parse(GetParam().value);
  const auto fleet = ParseFleetFile("f.json", json.dump());
  ASSERT_FALSE(fleet.ok());
  EXPECT_EQ(fleet.status().code(), absl::StatusCode::kInvalidArgument);
  const std::string message(fleet.status().message());
  EXPECT_THAT(message, HasSubstr("f.json: " + std::string(GetParam().place)));
  EXPECT_THAT(message, HasSubstr(GetParam().expected));
}

INSTANTIATE_TEST_SUITE_P(
    All, WrongFileTest,
    testing::Values(WrongFile{"/name", "\"a b\"", "name: found", "letters"},
                    WrongFile{"/name", "7", "name: found 7", "letters"},
                    WrongFile{"/scheduler", "\"pbs\"", "scheduler: found \"pbs\"", "\"slurm\" or an object"},
                    WrongFile{"/scheduler", "{\"submit\": [\"q\"], \"list\": [], \"cancel\": [\"c\"]}",
                              "scheduler.list: found []", "a list of words"},
                    WrongFile{"/scheduler", "{\"list\": [\"l\"], \"cancel\": [\"c\"]}",
                              "scheduler: found no field 'submit'", "this field"},
                    WrongFile{"/pilot", "\"pilot\"", "pilot: found", "absolute path"},
                    WrongFile{"/worker", "[]", "worker: found []", "program"},
                    WrongFile{"/options", "[1]", "options: found [1]", "a list of words"},
                    WrongFile{"/worth_s", "0", "worth_s: found 0", "seconds, 1 or more"},
                    WrongFile{"/interval_s", "\"10\"", "interval_s: found", "seconds"},
                    WrongFile{"/color", "1", "found unknown field 'color'", "interval_s"},
                    WrongFile{"/classes", "[]", "classes: found []", "1 to 32"},
                    WrongFile{"/classes/0", "3", "classes[0]: found 3", "an object"},
                    WrongFile{"/classes/0/memory", "\"16GB\"", "classes[0].memory: found", "GiB"},
                    WrongFile{"/classes/0/memory", "1000", "classes[0].memory: found 1000", "256 MiB"},
                    WrongFile{"/classes/0/memory", "\"2GiB\"", "classes[1].memory: found 2048 MiB again", "another"},
                    WrongFile{"/classes/0/name", "\"small\"", "classes[1].name: found 'small' again", "once"},
                    WrongFile{"/classes/0/cores", "1.5", "classes[0].cores: found 1.5",
                              "a whole number from 1 to 1024"},
                    WrongFile{"/classes/0/most", "0", "classes[0].most: found 0", "1 to 1000"},
                    WrongFile{"/classes/1/least", "21", "classes[1].least: found 21", "0 to 20"},
                    WrongFile{"/classes/0/time_limit_s", "30", "classes[0].time_limit_s: found 30", "60 or more"},
                    WrongFile{"/classes/0/gpu", "1", "classes[0]: found unknown field 'gpu'", "most_pending"}));

TEST(FleetFileTest, AllFaultsAreReported) {
  const auto fleet = ParseFleetFile("f.json", R"({"name": 1, "classes": [{"memory": true}]})");
  const std::string message(fleet.status().message());
  for (const char* place :
       {"name: found 1", "'scheduler'", "classes[0].memory", "'time_limit_s'", "'most'", "'name'"}) {
    EXPECT_THAT(message, HasSubstr(place));
  }
}

TEST(FleetFileTest, SyntaxErrorsHaveTheirByte) {
  EXPECT_THAT(ParseFleetFile("f.json", "{\"name\": }").status().ToString(), HasSubstr("f.json: byte 10"));
  EXPECT_THAT(ParseFleetFile("f.json", "[]").status().ToString(), HasSubstr("expected an object"));
  EXPECT_FALSE(ParseFleetFile("f.json", std::string(100000, '[')).ok());
}

TEST(FleetFileTest, WorkerGetsTheMemoryLessAMargin) {
  PilotClass pilots;
  pilots.memory_mib = 512;
  EXPECT_EQ(WorkerMemory_mib(pilots), 448);
  pilots.memory_mib = 16384;
  EXPECT_EQ(WorkerMemory_mib(pilots), 15565);
}

// Never more than a pilot has left when its worker registers.
TEST(FleetFileTest, WorkersLackTheTimeOfTheirStart) {
  PilotClass pilots;
  pilots.time_limit_s = 119;  // Slurm gets one minute
  EXPECT_EQ(WorkerTime_s(pilots), 54);
  pilots.time_limit_s = 3600;
  EXPECT_EQ(WorkerTime_s(pilots), 3540);
}

}  // namespace
}  // namespace tessera
