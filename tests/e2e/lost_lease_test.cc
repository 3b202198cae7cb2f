// Suspended and disconnected workers and repeatedly killed programs: one result with the same bytes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <cstdlib>
#include <functional>
#include <optional>
#include <random>
#include <thread>

#include "common/base/random.h"
#include "tests/e2e/programs.h"
#include "tests/e2e/tcp_proxy.h"

namespace tessera::e2e {
namespace {

using testing::HasSubstr;

class LostLeaseTest : public testing::Test {
 protected:
  // Waits until a measure task is leased.
  static v1::Task LeasedMeasure(Cluster& cluster, const std::string& job) {
    v1::Task leased;
    EXPECT_TRUE(WaitUntil([&] {
      for (const v1::Task& task : cluster.Tasks(job)) {
        if (task.kind() != "measure" || task.state() != v1::TASK_STATE_LEASED) continue;
        leased = task;
        return true;
      }
      return false;
    }));
    return leased;
  }
  static v1::Task TaskNow(Cluster& cluster, const std::string& job, const std::string& name) {
    for (const v1::Task& task : cluster.Tasks(job)) {
      if (task.name() == name) return task;
    }
    return {};
  }

  // Stops the only worker while it has a measure task, and gives that. Tasks take milliseconds: one that was leased
  // when it was looked at may have ended by then, so what is under way is waited for, a tenth of the lease.
  static v1::Task StoppedInMeasure(Cluster& cluster, const std::string& job, const std::function<void()>& stop,
                                   const std::function<void()>& go_on) {
    v1::Task task;
    EXPECT_TRUE(WaitUntil([&] {
      task = LeasedMeasure(cluster, job);
      stop();
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
      if (TaskNow(cluster, job, task.name()).state() == v1::TASK_STATE_LEASED) return true;
      go_on();
      return false;
    }));
    return task;
  }

  // The job's end: published once, with the bytes of a job that nothing happened to. Gives the attempts of `kind`.
  std::map<std::string, int> ExpectUndisturbed(Cluster& cluster, const std::string& name, const std::string& kind) {
    const v1::Job job = cluster.Await(name);
    EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error();
    if (job.state() != v1::JOB_STATE_SUCCEEDED) return {};
    const std::string out = cluster.Fetch(name);
    EXPECT_TRUE(Content(out + "/mesh.ply") == Content(UndisturbedMesh()));
    return AttemptsOf(out + "/job.json", kind);
  }

  // What a worker says whose attempt is not the current one any more: at its report, or before at a heartbeat.
  static bool ToldThatItIsLate(const Program& worker) {
    const std::string output = worker.Output();
    return output.find("report not accepted: the lease is lost") != std::string::npos ||
           output.find("lease lost: result discarded") != std::string::npos;
  }

  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
};

TEST_F(LostLeaseTest, LateReportOfSuspendedWorkerIsRefused) {
  Cluster cluster(folder_.path(), 2);
  Program& still = cluster.AddWorker();
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  const v1::Task task = StoppedInMeasure(
      cluster, job, [&] { still.Signal(SIGSTOP); }, [&] { still.Signal(SIGCONT); });
  cluster.AddWorker();
  ASSERT_TRUE(WaitUntil([&] { return TaskNow(cluster, job, task.name()).state() == v1::TASK_STATE_SUCCEEDED; }));
  EXPECT_EQ(TaskNow(cluster, job, task.name()).attempt(), task.attempt() + 1);
  EXPECT_FALSE(ToldThatItIsLate(still));
  still.Signal(SIGCONT);
  EXPECT_TRUE(WaitUntil([&] { return ToldThatItIsLate(still); })) << still.Output();
  EXPECT_EQ(ExpectUndisturbed(cluster, job, "measure")[task.title()], task.attempt() + 1);
}

// No data is forwarded, but no connection breaks: neither side notices.
TEST_F(LostLeaseTest, DisconnectionLongerThanLeaseLosesOneTask) {
  Cluster cluster(folder_.path(), 2);
  TcpProxy network(cluster.address());
  Program& away = cluster.AddWorker({"--coordinator", network.address()});
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  const v1::Task task = StoppedInMeasure(
      cluster, job, [&] { network.Set(TcpProxy::Mode::kStall); }, [&] { network.Set(TcpProxy::Mode::kPass); });
  cluster.AddWorker();
  ASSERT_TRUE(WaitUntil([&] { return TaskNow(cluster, job, task.name()).state() == v1::TASK_STATE_SUCCEEDED; }));
  EXPECT_EQ(TaskNow(cluster, job, task.name()).attempt(), task.attempt() + 1) << "one lease was lost";
  network.Set(TcpProxy::Mode::kPass);
  EXPECT_TRUE(WaitUntil([&] { return ToldThatItIsLate(away); })) << away.Output();
  EXPECT_EQ(ExpectUndisturbed(cluster, job, "measure")[task.title()], task.attempt() + 1);
}

TEST_F(LostLeaseTest, DisconnectionShorterThanLeaseLosesNothing) {
  Cluster cluster(folder_.path(), 60);
  TcpProxy network(cluster.address());
  network.SetDelay(0.01);
  Program& worker = cluster.AddWorker({"--coordinator", network.address(), "--no-shared-storage"});
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  LeasedMeasure(cluster, job);
  network.SetDelay(0);
  // The network is gone for a while, then every connection breaks once more.
  network.Set(TcpProxy::Mode::kCut);
  ASSERT_TRUE(WaitUntil([&] { return network.refused() >= 3; }));
  network.Set(TcpProxy::Mode::kPass);
  const int connections = network.accepted();
  ASSERT_TRUE(WaitUntil([&] { return network.accepted() > connections; }));
  LeasedMeasure(cluster, job);
  network.Drop();
  for (const auto& [title, attempts] : ExpectUndisturbed(cluster, job, "measure")) EXPECT_EQ(attempts, 1) << title;
  EXPECT_THAT(worker.Output(), testing::Not(HasSubstr("refused")));
}

// Kills a random program with SIGKILL each time the job has made a little progress.
TEST_F(LostLeaseTest, RandomKillsDoNotChangeTheResult) {
  constexpr int kRounds = 8;
  const char* given = std::getenv("TESSERA_TEST_SEED");
  const uint64_t seed = given != nullptr ? std::strtoull(given, nullptr, 10) : std::random_device()();
  SCOPED_TRACE(testing::Message() << "again with TESSERA_TEST_SEED=" << seed);
  std::printf("seed %llu\n", static_cast<unsigned long long>(seed));
  Random random(seed);
  Cluster cluster(folder_.path(), 2);
  cluster.AddWorker();
  cluster.AddWorker();
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  const auto changes = [&] {
    int count = 0;
    for (const v1::Task& task : cluster.Tasks(job))
      count += task.attempt() + (task.state() == v1::TASK_STATE_SUCCEEDED);
    return count;
  };
  const auto ended = [&] {
    v1::Job now;
    return cluster.connection().GetJob(job, &now).ok() && now.state() != v1::JOB_STATE_QUEUED &&
           now.state() != v1::JOB_STATE_RUNNING;
  };
  int kills = 0;
  for (; kills < kRounds && !ended(); ++kills) {
    const int from = changes(), wanted = 1 + static_cast<int>(random.Below(6));
    ASSERT_TRUE(WaitUntil([&] { return changes() >= from + wanted || ended(); }));
    const auto victim = static_cast<size_t>(random.Below(3));
    // A task that loses three workers is quarantined as what kills them: that is another promise. One that may have
    // lost one is spared, in any state: between this look and the kill it may be lost, and leased, once more.
    bool may_have_lost = false;
    for (const v1::Task& task : cluster.Tasks(job)) {
      may_have_lost = may_have_lost || (task.state() != v1::TASK_STATE_SUCCEEDED && task.attempt() > 1);
    }
    if (victim < 2 && !may_have_lost) {
      auto& workers = cluster.workers();
      workers[workers.size() - 1 - victim]->Kill();
      cluster.AddWorker();
    } else {
      cluster.coordinator().Kill();
      cluster.StartCoordinator();
    }
  }
  EXPECT_GT(kills, 2);
  const auto published = ExpectUndisturbed(cluster, job, "publish");
  EXPECT_EQ(published.size(), 1u);
}

}  // namespace
}  // namespace tessera::e2e
