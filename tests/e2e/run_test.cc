// `tessera run`: the whole pipeline with one command.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "server/client/job_text.h"
#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::IsSupersetOf;

class RunTest : public testing::Test {
 protected:
  RunTest() : folder_(TempFolder::Create(testing::TempDir()).value()), out_(folder_.path() + "/out") {}

  Outcome Run(const std::vector<std::string>& more, const std::string& scene = ToyCity()) {
    std::vector<std::string> arguments = {"run", scene, "--out", out_};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return Tessera(folder_.path(), arguments);
  }
  // Processes whose command line names this test's folder, but for `except`.
  std::vector<std::string> Processes(pid_t except) const {
    std::vector<std::string> found;
    for (const auto& entry : fs::directory_iterator("/proc")) {
      const std::string pid = entry.path().filename();
      if (pid.find_first_not_of("0123456789") != std::string::npos || std::stoi(pid) == except) continue;
      std::ifstream file(entry.path() / "cmdline");
      const std::string command((std::istreambuf_iterator<char>(file)), {});
      if (command.find(out_) != std::string::npos) found.push_back(pid);
    }
    return found;
  }

  TempFolder folder_;
  const std::string out_;
};

TEST_F(RunTest, ResultDoesNotDependOnNumberOfWorkers) {
  for (const std::string workers : {"2", "4"}) {
    fs::remove_all(out_);
    const Outcome outcome = Run({"--tiles", "4", "--workers", workers, "--threads-per-worker", "1"});
    ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
    EXPECT_GT(AttemptsOf(out_ + "/job.json", "measure").size(), 1u);
    EXPECT_TRUE(Content(out_ + "/mesh.ply") == Content(UndisturbedMesh())) << workers << " workers";
    EXPECT_THAT(outcome.output, HasSubstr("result: " + out_ + "/mesh.ply"));
  }
}

TEST_F(RunTest, ResultDoesNotDependOnSharedStorage) {
  const Outcome outcome = Run({"--tiles", "4", "--no-shared-storage"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_TRUE(Content(out_ + "/mesh.ply") == Content(UndisturbedMesh()));
}

TEST_F(RunTest, UntiledIsARefineTaskForTheCoarseLevelsAndOneForTheFinest) {
  const Outcome outcome = Run({"--tiles", "1"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_EQ(AttemptsOf(out_ + "/job.json", "refine").size(), 2u);
  EXPECT_TRUE(Content(out_ + "/mesh.ply") == Content(UndisturbedMesh())) << "four tiles give the same bytes";

  // The page shows the figures of report.json, and pictures of the start and of the result.
  EXPECT_THAT(outcome.output, HasSubstr("report: " + out_ + "/report.html"));
  const auto report = nlohmann::json::parse(Content(out_ + "/report.json"));
  const std::string page = Content(out_ + "/report.html");
  for (const auto& count : {report["output"]["faces"], report["output"]["vertices"], report["label_changes"]}) {
    EXPECT_THAT(page, HasSubstr("<dd>" + FormatThousands(count.get<int64_t>()) + "</dd>"));
  }
  for (const char* picture : {"Start", "Result", "Classes at the start", "Classes in the result", "Displacement"}) {
    EXPECT_THAT(page, HasSubstr("alt=\"" + std::string(picture) + "\""));
  }
  EXPECT_LT(page.size(), size_t{5} << 20);
}

TEST_F(RunTest, RepeatedRunReusesAllTasks) {
  ASSERT_EQ(Run({"--tiles", "4"}).exit_code, 0);
  const std::string mesh = Content(out_ + "/mesh.ply");
  fs::remove(out_ + "/mesh.ply");
  const Outcome again = Run({"--tiles", "4"});
  ASSERT_EQ(again.exit_code, 0) << again.output;
  EXPECT_TRUE(Content(out_ + "/mesh.ply") == mesh);
  const auto totals = nlohmann::json::parse(Content(out_ + "/job.json"))["totals"];
  EXPECT_GT(totals["tasks"], 5);
  EXPECT_EQ(totals["reused"], totals["tasks"]);
  EXPECT_EQ(totals["attempts"], 0);
}

TEST_F(RunTest, RunReusesSurveyOfPlanAndMatchesPrediction) {
  const std::string json = folder_.path() + "/plan.json", map = folder_.path() + "/plan.svg";
  const Outcome plan = Tessera(folder_.path(), {"plan", ToyCity(), "--tiles", "4", "--out", out_, "--json", json,
                                                "--map", map, "--workers", "2"});
  ASSERT_EQ(plan.exit_code, 0) << plan.output;
  EXPECT_THAT(plan.output, HasSubstr("tiles: 4"));
  EXPECT_THAT(Content(map), HasSubstr("</svg>"));
  const auto planned = nlohmann::json::parse(Content(json));
  ASSERT_EQ(Run({"--tiles", "4"}).exit_code, 0);
  std::map<std::pair<int, std::string>, double> predicted_s;  // of a tile's tasks of a kind
  std::set<std::string> measured;                             // kinds of tasks whose memory is known
  double stored = 0;
  const auto job = nlohmann::json::parse(Content(out_ + "/job.json"));
  for (const auto& task : job["tasks"]) {
    if (task["kind"] == "ingest") {
      EXPECT_EQ(task["reused"], true);
    }
    for (const auto& [name, file] : task["outputs"].items()) stored += file["size_bytes"].get<double>();
    int tile = task["tile"];
    if (tile < 0) continue;
    if (task["kind"] == "crop") {
      tile = 0;  // the small scene has one group of tiles
      const bool fine = task["title"].get<std::string>().ends_with("finest level");
      EXPECT_EQ(task["stats"]["views"] == 0, fine) << "the finest level reads the crops of the coarse levels";
    }
    // The plan counts the states with which the finest level starts to the cuts.
    const std::string kind = task["kind"] == "start" ? "cut" : task["kind"];
    predicted_s[{tile, kind}] += task["predicted"]["core_seconds"].get<double>();
    EXPECT_LE(task["predicted"]["peak_bytes"].get<double>(),
              1.05 * planned["tiles"][tile][kind]["peak_bytes"].get<double>());
    if (task["reused"] == true && kind == "cut") continue;  // plan's workers go on until they are stopped
    EXPECT_GT(task["used"]["core_seconds"], 0);
    if (task["used"]["peak_bytes"] > 1 << 20) measured.insert(kind);
  }
  EXPECT_THAT(measured, IsSupersetOf({"crop", "measure", "solve", "mend"})) << "of each kind at least the first task's";
  EXPECT_LT(stored, 1.5 * planned["stored_bytes"].get<double>());
  EXPECT_GT(stored, 0.5 * planned["stored_bytes"].get<double>());
  EXPECT_EQ(predicted_s.size(), 4u * 4 + 1) << "cut, measure, solve, mend, and crop for all";
  for (const auto& [task, seconds] : predicted_s) {
    const auto& [tile, kind] = task;
    // How many faces the second split will make is not known exactly.
    double planned_s = 0;
    for (int of_tile = 0; of_tile < 4; ++of_tile) {
      if (of_tile == tile || kind == "crop") {
        planned_s += planned["tiles"][of_tile][kind]["core_seconds"].get<double>();
      }
    }
    EXPECT_NEAR(seconds, planned_s, 0.2 * planned_s) << kind;
  }
  EXPECT_TRUE(Content(out_ + "/mesh.ply") == Content(UndisturbedMesh()));
}

TEST_F(RunTest, PlanAndRunRefuseTileMemoryThatIsTooSmall) {
  for (const char* command : {"plan", "run"}) {
    const Outcome outcome = Tessera(folder_.path(), {command, ToyCity(), "--tile-memory", "1MiB", "--out", out_});
    EXPECT_EQ(outcome.exit_code, 2) << command << ": a limit that no worker keeps";
    EXPECT_THAT(outcome.output, HasSubstr("tile memory: found 1048576 bytes"));
  }
}

TEST_F(RunTest, InterruptStopsAllChildProcesses) {
  for (const int signal : {SIGINT, SIGTERM}) {
    fs::remove_all(out_);
    Program run(folder_.path(), TESSERA_PROGRAM, {"run", ToyCity(), "--tiles", "4", "--out", out_});
    ASSERT_TRUE(WaitUntil([&] { return run.Output().find("measure") != std::string::npos; })) << run.Output();
    EXPECT_GE(Processes(run.pid()).size(), 2u);
    run.Signal(signal);
    const Outcome outcome = run.Wait();
    EXPECT_EQ(outcome.exit_code, 130) << outcome.output;
    EXPECT_THAT(Processes(run.pid()), testing::IsEmpty());
    EXPECT_FALSE(fs::exists(out_ + "/mesh.ply"));
  }
  // What was done before is not done again.
  EXPECT_EQ(Run({"--tiles", "4"}).exit_code, 0);
  EXPECT_GT(nlohmann::json::parse(Content(out_ + "/job.json"))["totals"]["reused"], 0);
}

TEST_F(RunTest, KilledRunLeavesNoProcess) {
  Program run(folder_.path(), TESSERA_PROGRAM, {"run", ToyCity(), "--tiles", "4", "--out", out_});
  ASSERT_TRUE(WaitUntil([&] { return run.Output().find("measure") != std::string::npos; })) << run.Output();
  run.Kill();
  EXPECT_TRUE(WaitUntil([&] { return Processes(0).empty(); }, 20));
}

TEST_F(RunTest, KilledWorkerIsReplacedAndReported) {
  Program run(folder_.path(), TESSERA_PROGRAM, {"run", ToyCity(), "--tiles", "4", "--workers", "1", "--out", out_});
  ASSERT_TRUE(WaitUntil([&] { return run.Output().find("measure") != std::string::npos; })) << run.Output();
  for (const std::string& pid : Processes(run.pid())) {
    std::ifstream file("/proc/" + pid + "/comm");
    std::string name;
    std::getline(file, name);
    if (name == "tessera-worker") ::kill(std::stoi(pid), SIGKILL);
  }
  const Outcome outcome = run.Wait();
  EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("signal 9"));
  EXPECT_THAT(outcome.output, HasSubstr("starting a replacement"));
  EXPECT_TRUE(Content(out_ + "/mesh.ply") == Content(UndisturbedMesh()));
}

TEST_F(RunTest, DeadCoordinatorIsReportedWithItsLog) {
  Program run(folder_.path(), TESSERA_PROGRAM, {"run", ToyCity(), "--tiles", "4", "--out", out_});
  ASSERT_TRUE(WaitUntil([&] { return run.Output().find("jobs/1") != std::string::npos; })) << run.Output();
  for (const std::string& pid : Processes(run.pid())) {
    std::ifstream file("/proc/" + pid + "/comm");
    std::string name;
    std::getline(file, name);
    if (name == "tesserad") ::kill(std::stoi(pid), SIGKILL);
  }
  const Outcome outcome = run.Wait();
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.output, HasSubstr("tesserad ended with signal 9"));
  EXPECT_THAT(outcome.output, HasSubstr("coordinator started"));
  EXPECT_THAT(Processes(run.pid()), testing::IsEmpty());
}

TEST_F(RunTest, SecondRunInTheSameFolderIsRefused) {
  Program first(folder_.path(), TESSERA_PROGRAM, {"run", ToyCity(), "--tiles", "4", "--out", out_});
  ASSERT_TRUE(WaitUntil([&] { return first.Output().find("jobs/1") != std::string::npos; })) << first.Output();
  const Outcome second = Run({"--tiles", "4"});
  EXPECT_EQ(second.exit_code, 1);
  EXPECT_THAT(second.output, HasSubstr("another tessera run"));
  first.Signal(SIGINT);
  EXPECT_EQ(first.Wait().exit_code, 130);
}

// A true start, which refinement cannot improve: at a GSD of 0.3 m the noise of the images roughens it if the weight of
// smoothness is small, and averages out if it is large.
TEST_F(RunTest, ResultThatFitsWorseThanItsStartHasExitCode5) {
  const std::string scene = folder_.path() + "/city";
  fs::copy(ToyCity(), scene, fs::copy_options::recursive);
  fs::copy_file(scene + "/truth/mesh.ply", scene + "/mesh.ply", fs::copy_options::overwrite_existing);
  const Outcome smooth = Run({"--thin-plate", "1"}, scene);
  EXPECT_EQ(smooth.exit_code, 0) << smooth.output;
  EXPECT_THAT(smooth.output, HasSubstr("fit of images: "));
  fs::remove_all(out_);
  const Outcome rough = Run({"--thin-plate", "0.01", "--max-step-px", "4"}, scene);
  EXPECT_EQ(rough.exit_code, 5) << rough.output;
  EXPECT_THAT(rough.output, HasSubstr("the result fits the images worse than the start mesh"));
  const auto report = nlohmann::json::parse(Content(out_ + "/report.json"));
  EXPECT_EQ(report.at("fit_change").at("worse"), true);
  EXPECT_GT(report["fit_change"]["became_worse"], report["fit_change"]["became_better"]);
  EXPECT_TRUE(fs::exists(out_ + "/mesh.ply"));

  // The same from a coordinator.
  Cluster cluster(folder_.path());
  cluster.AddWorker();
  const Outcome submitted =
      Tessera(folder_.path(), {"submit", scene, "--thin-plate", "0.01", "--max-step-px", "4", "--watch",
                               "--coordinator", cluster.address()});
  EXPECT_EQ(submitted.exit_code, 5) << submitted.output;
  EXPECT_THAT(submitted.output, HasSubstr("jobs/1: the result fits the images worse than the start mesh"));
  EXPECT_EQ(Tessera(folder_.path(), {"watch", "1", "--coordinator", cluster.address()}).exit_code, 5);
}

TEST_F(RunTest, ImagesOfOtherPlacesAreNamed) {
  const std::string scene = folder_.path() + "/city", images = scene + "/images/";
  fs::copy(ToyCity(), scene, fs::copy_options::recursive);
  for (const std::string flight : {"west", "east"}) {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(images)) {
      const std::string name = entry.path().filename();
      if (name.starts_with(flight)) names.push_back(name);
    }
    ASSERT_GT(names.size(), 1u);
    std::sort(names.begin(), names.end());
    fs::rename(images + names[0], images + "first");
    for (size_t i = 1; i < names.size(); ++i) fs::rename(images + names[i], images + names[i - 1]);
    fs::rename(images + "first", images + names.back());
  }
  EXPECT_THAT(Run({"--anyway"}, scene).output, HasSubstr("images that disagree with all others: "));
}

}  // namespace
}  // namespace tessera::e2e
