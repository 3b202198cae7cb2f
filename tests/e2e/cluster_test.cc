// Coordinator and workers that are killed, restarted or without shared storage.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <filesystem>
#include <optional>

#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class ClusterTest : public testing::Test {
 protected:
  ClusterTest() : folder_(TempFolder::Create(testing::TempDir()).value()) {}

  // A measure task that is leased now.
  static std::optional<v1::Task> LeasedMeasure(Cluster& cluster, const std::string& job) {
    for (const v1::Task& task : cluster.Tasks(job)) {
      if (task.kind() == "measure" && task.state() == v1::TASK_STATE_LEASED) return task;
    }
    return std::nullopt;
  }
  static pid_t PidOf(Cluster& cluster, const std::string& worker) {
    v1::ListWorkersResponse workers;
    EXPECT_TRUE(cluster.connection().ListWorkers(&workers).ok());
    for (const v1::Worker& one : workers.workers()) {
      if (one.name() == worker) return one.pid();
    }
    return 0;
  }

  TempFolder folder_;
};

TEST_F(ClusterTest, KilledWorkerDoesNotChangeTheResult) {
  Cluster cluster(folder_.path());
  cluster.AddWorker();
  cluster.AddWorker();
  const v1::Job submitted = cluster.Submit(ToyCity(), 4);
  std::optional<v1::Task> victim;
  ASSERT_TRUE(WaitUntil([&] { return (victim = LeasedMeasure(cluster, submitted.name())).has_value(); }));
  const pid_t pid = PidOf(cluster, victim->worker());
  ASSERT_NE(pid, 0);
  bool killed = false;
  for (auto& worker : cluster.workers()) {
    if (worker->pid() != pid) continue;
    worker->Kill();
    killed = true;
  }
  ASSERT_TRUE(killed);
  const v1::Job job = cluster.Await(submitted.name());
  ASSERT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error();
  const std::string out = cluster.Fetch(job.name());
  EXPECT_EQ(AttemptsOf(out + "/job.json", "measure")[victim->title()], 2);
  EXPECT_TRUE(Content(out + "/mesh.ply") == Content(UndisturbedMesh()));
}

TEST_F(ClusterTest, KilledCoordinatorResumesTheJob) {
  Cluster cluster(folder_.path(), 15);
  cluster.AddWorker();
  cluster.AddWorker();
  const v1::Job submitted = cluster.Submit(ToyCity(), 4);
  std::optional<v1::Task> running;
  ASSERT_TRUE(WaitUntil([&] { return (running = LeasedMeasure(cluster, submitted.name())).has_value(); }));
  Program watch(folder_.path(), TESSERA_PROGRAM, {"watch", submitted.name(), "--coordinator", cluster.address()});
  ASSERT_TRUE(WaitUntil([&] { return watch.Output().find("measure") != std::string::npos; })) << watch.Output();
  cluster.coordinator().Kill();
  cluster.StartCoordinator();
  const v1::Job job = cluster.Await(submitted.name());
  ASSERT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error();
  const std::string out = cluster.Fetch(job.name());
  EXPECT_TRUE(Content(out + "/mesh.ply") == Content(UndisturbedMesh()));
  EXPECT_EQ(AttemptsOf(out + "/job.json", "measure")[running->title()], 1) << "the worker went on meanwhile";
  const Outcome watched = watch.Wait();
  EXPECT_EQ(watched.exit_code, 0) << watched.output;
  EXPECT_THAT(watched.output, HasSubstr("tiles 4/4"));
}

TEST_F(ClusterTest, ResultDoesNotDependOnWorkersJoiningAndLeaving) {
  Cluster cluster(folder_.path());
  const v1::Job submitted = cluster.Submit(ToyCity(), 4);
  Program& first = cluster.AddWorker();
  ASSERT_TRUE(WaitUntil([&] { return LeasedMeasure(cluster, submitted.name()).has_value(); }));
  first.Signal(SIGTERM);
  EXPECT_EQ(first.Wait().exit_code, 0);
  v1::ListWorkersResponse workers;
  ASSERT_TRUE(cluster.connection().ListWorkers(&workers).ok());
  EXPECT_EQ(workers.workers_size(), 0);
  cluster.AddWorker();
  const v1::Job job = cluster.Await(submitted.name());
  ASSERT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error();
  EXPECT_TRUE(Content(cluster.Fetch(job.name()) + "/mesh.ply") == Content(UndisturbedMesh()));
}

// The scene and the coordinator's folder belong to root alone; the worker is nobody. Without root, the worker gets a
// mount name space in which an empty file system covers them.
TEST_F(ClusterTest, WorkerWithoutSharedFolderUsesBlobService) {
  const std::string hidden = folder_.path() + "/hidden";
  ASSERT_TRUE(EnsureFolder(hidden).ok());
  fs::copy(ToyCity(), hidden + "/city", fs::copy_options::recursive);
  const std::string work = folder_.path() + "/work";
  ASSERT_TRUE(EnsureFolder(work).ok());
  std::vector<std::string> before;
  if (::geteuid() == 0) {
    for (const std::string& open : {folder_.path(), work}) fs::permissions(open, fs::perms::all);
    fs::permissions(hidden, fs::perms::owner_all);
    before = {"/usr/bin/setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"};
  } else {
    before = {"/usr/bin/unshare",
              "--map-root-user",
              "--mount",
              "/bin/sh",
              "-c",
              "mount -t tmpfs none '" + hidden + "' && exec \"$0\" \"$@\""};
  }
  // Nothing is proved unless it really cannot read there.
  std::vector<std::string> look(before.begin() + 1, before.end());
  look.insert(look.end(), {"/bin/cat", hidden + "/city/scene.json"});
  const Outcome seen = Program(folder_.path(), before.front(), look).Wait();
  if (seen.exit_code == 0) FAIL() << "the worker would read the scene: " << seen.output;
  std::vector<std::string> nothing(before.begin() + 1, before.end());
  nothing.push_back("/bin/true");
  if (Program(folder_.path(), before.front(), nothing).Wait().exit_code != 0) {
    GTEST_SKIP() << "neither another user nor a mount name space is allowed here";
  }

  for (const bool told : {false, true}) {
    Cluster cluster(hidden + "/coordinator" + (told ? "-1" : "-0"));
    const std::vector<std::string> flag =
        told ? std::vector<std::string>{"--no-shared-storage"} : std::vector<std::string>();
    std::vector<std::string> arguments = {"--work", work};
    arguments.insert(arguments.end(), flag.begin(), flag.end());
    Program& worker = cluster.AddWorker(arguments, before);
    const v1::Job job = cluster.Await(cluster.Submit(hidden + "/city", 4).name());
    ASSERT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error() << worker.Output();
    EXPECT_TRUE(Content(cluster.Fetch(job.name()) + "/mesh.ply") == Content(UndisturbedMesh()));
    EXPECT_THAT(worker.Output(), HasSubstr("blob service"));
    EXPECT_THAT(worker.Output(), testing::Not(HasSubstr("shared storage")));
    worker.Signal(SIGTERM);
    EXPECT_EQ(worker.Wait().exit_code, 0);
  }
}

TEST_F(ClusterTest, RepeatedRequestIdReturnsTheSameJob) {
  Cluster cluster(folder_.path());
  const std::string name = cluster.Submit(ToyCity(), 4, "request-1").name();
  EXPECT_EQ(cluster.Submit(ToyCity(), 4, "request-1").name(), name);
  EXPECT_NE(cluster.Submit(ToyCity(), 4, "request-2").name(), name);
  cluster.coordinator().Kill();
  cluster.StartCoordinator();
  EXPECT_EQ(cluster.Submit(ToyCity(), 4, "request-1").name(), name);
}

TEST_F(ClusterTest, CommandsOfAJobsLifecycle) {
  Cluster cluster(folder_.path());
  const auto tessera = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--coordinator", cluster.address()});
    return Tessera(folder_.path(), arguments);
  };
  EXPECT_THAT(tessera({"submit", ToyCity(), "--validate-only"}).output, HasSubstr("valid"));
  EXPECT_EQ(tessera({"submit", ToyCity(), "--tiles", "4"}).output, "jobs/1\n");
  EXPECT_THAT(tessera({"jobs"}).output, HasSubstr("jobs/1  queued"));
  EXPECT_THAT(tessera({"jobs", "1"}).output, HasSubstr("no worker is registered"));
  EXPECT_EQ(tessera({"priority", "1", "5"}).output, "jobs/1 queued, priority 5\n");
  EXPECT_EQ(tessera({"pause", "1"}).output, "jobs/1 paused, priority 5\n");
  EXPECT_THAT(tessera({"jobs", "jobs/1"}).output, HasSubstr("reason     paused"));
  EXPECT_EQ(tessera({"resume", "1"}).output, "jobs/1 queued, priority 5\n");
  EXPECT_EQ(tessera({"retry", "1"}).exit_code, 1);
  EXPECT_EQ(tessera({"fetch", "1", "--out", folder_.path() + "/out"}).exit_code, 1);
  EXPECT_EQ(tessera({"cancel", "jobs/1"}).output, "jobs/1 cancelled\n");
  EXPECT_EQ(tessera({"watch", "1"}).exit_code, 130);
  EXPECT_THAT(tessera({"pause", "1"}).output, HasSubstr("jobs/1 has ended"));
  EXPECT_EQ(tessera({"fetch", "1", "--out", folder_.path() + "/out"}).exit_code, 1);
  EXPECT_EQ(tessera({"watch", "jobs/99"}).exit_code, 3);
  cluster.AddWorker();
  const Outcome watched = tessera({"submit", ToyCity(), "--tiles", "4", "--watch"});
  EXPECT_EQ(watched.exit_code, 0) << watched.output;
  EXPECT_THAT(watched.output, HasSubstr("tiles 4/4"));
  EXPECT_THAT(tessera({"jobs", "--workers"}).output, HasSubstr("workers/1-1"));
  EXPECT_THAT(tessera({"jobs", "--json"}).output, HasSubstr("\"JOB_STATE_SUCCEEDED\""));
  EXPECT_THAT(tessera({"watch", "2", "--json"}).output, HasSubstr("\"tiles_done\":4"));
  EXPECT_TRUE(Content(cluster.Fetch("jobs/2") + "/mesh.ply") == Content(UndisturbedMesh()));
  EXPECT_FALSE(fs::exists(folder_.path() + "/fetched/.fetch"));
}

TEST(CommandTest, ExitCodesOfWrongArgumentsAndUnavailableCoordinator) {
  const TempFolder folder = TempFolder::Create(testing::TempDir()).value();
  EXPECT_EQ(Tessera(folder.path(), {"run"}).exit_code, 2);
  EXPECT_EQ(Tessera(folder.path(), {"submit", "x", "--tiles", "many"}).exit_code, 2);
  const Outcome nobody = Tessera(folder.path(), {"jobs", "--coordinator", "127.0.0.1:1"});
  EXPECT_EQ(nobody.exit_code, 4);
  EXPECT_THAT(nobody.output, HasSubstr("127.0.0.1:1"));
}

}  // namespace
}  // namespace tessera::e2e
