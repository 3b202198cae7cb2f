// `tessera fleet` with Slurm: pilots come and go, and the city has the bytes of `tessera run`.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "server/fleet/run_command.h"
#include "tests/e2e/programs.h"
#include "tests/support/servers/test_server.h"

namespace tessera::e2e {
namespace {

using testing::HasSubstr;
using testing::Not;
using Json = nlohmann::json;

// A Slurm of its own for each test, with two nodes of one core, and a coordinator.
class SlurmFleetTest : public testing::Test {
 protected:
  void SetUp() override {
    const Outcome started = SlurmServer({"start"});
    if (FileExists(slurm_ + "/missing")) {
      if (ServersAreRequired()) FAIL() << started.output;
      GTEST_SKIP() << started.output;
    }
    ASSERT_EQ(started.exit_code, 0) << started.output;
    ::setenv("SLURM_CONF", (slurm_ + "/slurm.conf").c_str(), 1);
    cluster_ = std::make_unique<Cluster>(folder_.path());
  }
  void TearDown() override {
    fleet_ = nullptr;
    if (cluster_ != nullptr) SlurmServer({"stop"});
    ::unsetenv("SLURM_CONF");
  }

  Outcome SlurmServer(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), slurm_);
    return Program(folder_.path(), TESSERA_START_SLURM, arguments).Wait();
  }
  std::string Run(const std::vector<std::string>& words) {
    const auto output = RunCommand(words, {});
    EXPECT_TRUE(output.ok()) << output.status();
    return output.value_or("");
  }

  // Two classes of pilots that end 1 s after their last task.
  void WriteFleet(const std::string& worker = TESSERA_WORKER_PROGRAM) {
    const Json json = {{"name", "toy"},
                       {"scheduler", "slurm"},
                       {"pilot", TESSERA_PILOT},
                       {"worker", {worker, "--coordinator", cluster_->address(), "--idle-s", "1", "--drain-s", "1"}},
                       {"options", {"--partition=low"}},
                       {"worth_s", 1},
                       {"interval_s", 1},
                       {"classes",
                        {{{"name", "small"}, {"memory", "1GiB"}, {"time_limit_s", 600}, {"most", 2}},
                         {{"name", "large"}, {"memory", "3GiB"}, {"time_limit_s", 600}, {"least", 1}, {"most", 1}}}}};
    std::ofstream(folder_.path() + "/fleet.json") << json.dump();
  }
  std::vector<std::string> FleetWords(const std::vector<std::string>& more = {}) {
    std::vector<std::string> words = {"fleet",         folder_.path() + "/fleet.json",
                                      "--state",       folder_.path() + "/state",
                                      "--coordinator", cluster_->address()};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  void StartFleet() { fleet_ = std::make_unique<Program>(folder_.path(), TESSERA_PROGRAM, FleetWords()); }
  bool AwaitOutput(const std::string& what, double seconds = 60) {
    return WaitUntil([&] { return fleet_->Output().find(what) != std::string::npos; }, seconds);
  }
  int CountInOutput(const std::string& what) {
    int count = 0;
    const std::string output = fleet_->Output();
    for (size_t at = output.find(what); at != std::string::npos; at = output.find(what, at + 1)) ++count;
    return count;
  }
  // Jobs of these classes in these states ("R,PD", "all"), as squeue names them.
  std::vector<std::string> JobsIn(const std::string& states, const std::vector<std::string>& classes) {
    std::vector<std::string> words = {"squeue", "-h", "-r", "-o", "%i", "-t", states, "-n"};
    words.push_back(absl::StrJoin(
        classes, ",", [](std::string* out, const std::string& name) { out->append("tessera.toy." + name); }));
    std::vector<std::string> jobs = absl::StrSplit(Run(words), '\n', absl::SkipEmpty());
    return jobs;
  }
  // A pilot that runs and whose worker has a task.
  std::string AwaitBusyPilot(const std::string& other_than = "") {
    std::string busy;
    EXPECT_TRUE(WaitUntil(
        [&] {
          const Outcome shown = Tessera(folder_.path(), FleetWords({"--status", "--json"}));
          const Json status = Json::parse(shown.output, nullptr, false);
          if (!status.is_object()) return false;
          for (const Json& pilot : status["pilots"]) {
            if (pilot["tasks"].empty() || pilot["job"] == other_than) continue;
            EXPECT_THAT(pilot["tasks"][0]["title"].get<std::string>(), Not(HasSubstr("/tasks/")));
            busy = pilot["job"];
          }
          return !busy.empty();
        },
        60))
        << fleet_->Output();
    return busy;
  }

  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
  const std::string slurm_ = folder_.path() + "/slurm";
  std::unique_ptr<Cluster> cluster_;
  std::unique_ptr<Program> fleet_;
};

// One pilot is killed without a word, one preempted, and the fleet itself is killed and started again.
TEST_F(SlurmFleetTest, CityIsRefinedFromAnEmptyFleetToAnEmptyQueue) {
  const std::string expected = Content(UndisturbedMesh());
  WriteFleet();
  StartFleet();
  const std::string job = cluster_->Submit(ToyCity(), 4).name();
  ASSERT_TRUE(AwaitOutput("submitted 1 pilots of class large")) << fleet_->Output();
  ASSERT_TRUE(AwaitOutput("pilots of class small")) << fleet_->Output();
  fleet_->Kill();
  StartFleet();
  const std::string killed = AwaitBusyPilot();
  Run({"scancel", "--full", "--signal=KILL", killed});
  AwaitBusyPilot(killed);
  Run({"sbatch", "--partition=high", "--cpus-per-task=1", "--mem=100M", "--output=/dev/null", "--wrap=sleep 3"});
  const v1::Job ended = cluster_->Await(job);
  EXPECT_EQ(ended.state(), v1::JOB_STATE_SUCCEEDED) << ended.error();
  EXPECT_TRUE(Content(cluster_->Fetch(job) + "/mesh.ply") == expected);
  EXPECT_TRUE(WaitUntil([&] { return JobsIn("PD", {"small"}).empty(); }, 30)) << "no task needs them";
  fleet_->Signal(SIGTERM);
  const Outcome stopped = fleet_->Wait();
  EXPECT_EQ(stopped.exit_code, 0) << stopped.output;
  EXPECT_THAT(stopped.output, HasSubstr("fleet stopped"));
  EXPECT_TRUE(WaitUntil(
      [&] {
        return JobsIn("PD,R,CG", {"small", "large"}).empty();
      },
      30))
      << "pilots end when they are idle";
}

// Pilots take memory, cores and time from Slurm, and the fleet asks for workers of just this size.
TEST_F(SlurmFleetTest, WorkersHaveTheMemoryOfTheirClass) {
  WriteFleet();
  StartFleet();
  ASSERT_TRUE(AwaitOutput("submitted 1 pilots of class large")) << fleet_->Output();
  v1::ListWorkersResponse workers;
  ASSERT_TRUE(WaitUntil([&] {
    workers.Clear();
    return cluster_->connection().ListWorkers(&workers).ok() && workers.workers_size() == 1;
  })) << fleet_->Output();
  EXPECT_EQ(workers.workers(0).memory_bytes(), (int64_t{3072} - 153) << 20);
  EXPECT_EQ(workers.workers(0).threads(), 1);
  EXPECT_EQ(workers.workers(0).allocation(), Run({"squeue", "-h", "-o", "%A"}).substr(0, 1));
  EXPECT_GT(workers.workers(0).time_left_s(), 500);
  EXPECT_LE(workers.workers(0).time_left_s(), 600);
}

TEST_F(SlurmFleetTest, WrongPathOfTheWorkerStopsTheClass) {
  WriteFleet("/no/such/worker");
  StartFleet();
  ASSERT_TRUE(AwaitOutput("class large is stopped until")) << fleet_->Output();
  EXPECT_THAT(fleet_->Output(), HasSubstr("/no/such/worker: No such file or directory"));
  const int rounds = 3;
  EXPECT_FALSE(WaitUntil([&] { return CountInOutput("submitted 1 pilots of class large") > 3; }, rounds));
  EXPECT_EQ(JobsIn("all", {"small", "large"}).size(), 3u);
  const Outcome shown = Tessera(folder_.path(), FleetWords({"--status"}));
  EXPECT_EQ(shown.exit_code, 0);
  EXPECT_THAT(shown.output, HasSubstr("No such file"));
}

TEST_F(SlurmFleetTest, NothingIsSubmittedWithoutTheController) {
  WriteFleet();
  ASSERT_EQ(SlurmServer({"kill", "controller"}).exit_code, 0);
  StartFleet();
  ASSERT_TRUE(AwaitOutput("the list of jobs is invalid")) << fleet_->Output();
  EXPECT_EQ(CountInOutput("submitted"), 0) << fleet_->Output();
  ASSERT_EQ(SlurmServer({"again", "controller"}).exit_code, 0);
  EXPECT_TRUE(AwaitOutput("submitted 1 pilots of class large")) << fleet_->Output();
}

// Two fleets of one name: on one machine the second does not start; on two, no class has more than `most`.
TEST_F(SlurmFleetTest, TwoFleetsKeepToMost) {
  WriteFleet();
  StartFleet();
  ASSERT_TRUE(AwaitOutput("submitted 1 pilots of class large")) << fleet_->Output();
  const Outcome second = Tessera(folder_.path(), FleetWords({"--once"}));
  EXPECT_EQ(second.exit_code, 1);
  EXPECT_THAT(second.output, HasSubstr("another `tessera fleet` with the name 'toy' is running"));
  auto elsewhere = FleetWords({"--once"});
  elsewhere[3] += "-of-another-machine";
  const Outcome other = Tessera(folder_.path(), elsewhere);
  EXPECT_EQ(other.exit_code, 0) << other.output;
  EXPECT_EQ(JobsIn("all", {"small", "large"}).size(), 1u);
}

}  // namespace
}  // namespace tessera::e2e
