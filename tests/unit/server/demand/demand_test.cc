#include "server/demand/demand.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/random.h"
#include "server/leases/dispatch_core.h"
#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

using testing::ElementsAre;

constexpr int64_t kDemandGiB = int64_t{1} << 30;

// Cuts need 2 GiB, refine tasks 12 GiB; a tile's refine task takes (tile + 1) * 100 core-seconds.
class SizedPlanner : public FakePlanner {
 public:
  SizedPlanner() { exchange = true; }
  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>& files, const UpdateBase* base,
                                           const FinePart* fine) override {
    return Sized(FakePlanner::Tiles(settings, survey, files, base, fine));
  }
  StatusOr<std::vector<PlannedTask>> Steps(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>& files, const std::vector<TileReads>& reads,
                                           const UpdateBase* base, const std::vector<FailedTile>& without,
                                           const FinePart* fine) override {
    return Sized(FakePlanner::Steps(settings, survey, files, reads, base, without, fine));
  }

 private:
  static StatusOr<std::vector<PlannedTask>> Sized(StatusOr<std::vector<PlannedTask>> tasks) {
    for (PlannedTask& task : *tasks) {
      task.peak_bytes = task.kind == "refine" ? 12 * kDemandGiB : 2 * kDemandGiB;
      task.cost *= 100;
    }
    return tasks;
  }
};

class DemandTest : public CoordinatorTest {
 protected:
  DemandTest() { coordinator_ = *Coordinator::Open({&store_, blobs_.get(), &sized_, &clock_, {}}, options_); }

  Demand Now(double worth_s = 1, const std::vector<WorkerClass>& classes = {{4 * kDemandGiB}, {16 * kDemandGiB}}) {
    DispatchCore& core = coordinator_->core();
    std::lock_guard lock(core.mutex());
    return DemandOf(core.ledger(), classes, worth_s);
  }
  std::vector<int> Workers(const Demand& demand) {
    std::vector<int> workers;
    for (const ClassDemand& each : demand.classes) workers.push_back(each.workers);
    return workers;
  }
  std::string AnyWorker() { return *coordinator_->leases().RegisterWorker({"host", 1, 2, 0, 0, "host/boot"}); }
  // A job of so many tiles, whose cuts are done.
  std::string CutJob(int tiles) {
    const std::string job = Create(AJob(tiles, "scene " + std::to_string(tiles))), worker = AnyWorker();
    EXPECT_TRUE(coordinator_->jobs().ChangeJob(job, {++priority_, {}}).ok());  // the worker takes this job's tasks
    for (int i = 0; i < tiles + 1; ++i) EXPECT_TRUE(Succeed(worker, *Lease(worker)).ok());
    return job;
  }
  SizedPlanner sized_;
  int priority_ = 0;
};

TEST_F(DemandTest, NoJobWantsNoWorker) { EXPECT_THAT(Workers(Now()), ElementsAre(0, 0)); }

TEST_F(DemandTest, WidestPhaseBoundedByTheWork) {
  CutJob(4);
  const Demand demand = Now();
  EXPECT_THAT(Workers(demand), ElementsAre(4, 4)) << "four refine tasks at once; the publish task is narrower";
  EXPECT_EQ(demand.classes[0].core_s, 100);
  EXPECT_EQ(demand.classes[1].core_s, 100 * (1 + 2 + 3 + 4));
  EXPECT_THAT(Workers(Now(300)), ElementsAre(3, 3)) << "1,000 core-seconds are enough for three workers";
  EXPECT_THAT(Workers(Now(300, {{4 * kDemandGiB, 2}, {16 * kDemandGiB, 2}})), ElementsAre(1, 1)) << "of two cores";
  EXPECT_THAT(Workers(Now(1e6)), ElementsAre(1, 1)) << "little work still needs a worker";
}

TEST_F(DemandTest, DefaultClassesHoldAllTasks) {
  CutJob(2);
  const Demand demand = Now(1, DefaultClasses());
  EXPECT_THAT(Workers(demand), ElementsAre(2, 2, 2, 2, 2, 0, 0, 0)) << "16 GiB is the class of 12 GiB";
  EXPECT_EQ(demand.unfit_count, 0);
}

TEST_F(DemandTest, PausedJobsWantNone) {
  const std::string job = CutJob(4);
  ASSERT_TRUE(coordinator_->jobs().ChangeJob(job, {{}, true}).ok());
  EXPECT_THAT(Workers(Now()), ElementsAre(0, 0));
  ASSERT_TRUE(coordinator_->jobs().ChangeJob(job, {{}, false}).ok());
  EXPECT_THAT(Workers(Now()), ElementsAre(4, 4));
  ASSERT_TRUE(coordinator_->jobs().CancelJob(job).ok());
  EXPECT_THAT(Workers(Now()), ElementsAre(0, 0));
}

TEST_F(DemandTest, HeldJobsWantNone) {
  CutJob(4);
  DispatchCore& core = coordinator_->core();
  {
    std::lock_guard lock(core.mutex());
    core.ledger().ready().Hold(0);
  }
  EXPECT_THAT(Workers(Now()), ElementsAre(0, 0));
}

// Its tasks no longer count, and take no memory.
TEST_F(DemandTest, EndedJobWantsAWorkerOnlyForALostResult) {
  const std::string job = CutJob(2), worker = AnyWorker();
  EXPECT_EQ(WorkAll(worker), 3);
  ASSERT_EQ(Job(job).header.state, JobState::kSucceeded);
  EXPECT_THAT(Workers(Now()), ElementsAre(0, 0));
  EXPECT_TRUE(coordinator_->core().ledger().jobs()[0].totals.work().empty());
  const std::vector<NamedDigest> artifacts = Job(job).artifacts;
  const auto mesh = std::find_if(artifacts.begin(), artifacts.end(),
                                 [](const NamedDigest& artifact) { return artifact.name == "mesh.ply"; });
  ASSERT_NE(mesh, artifacts.end());
  std::filesystem::remove(*blobs_->LocalPath(mesh->digest));
  ASSERT_TRUE(coordinator_->recovery().RemakeArtifact(mesh->digest).ok());
  EXPECT_THAT(Workers(Now()), ElementsAre(1, 0)) << "to publish again";
  EXPECT_EQ(WorkAll(worker), 1);
  EXPECT_THAT(Workers(Now()), ElementsAre(0, 0));
}

TEST_F(DemandTest, JobsAddUp) {
  CutJob(4);
  CutJob(3);
  EXPECT_THAT(Workers(Now()), ElementsAre(7, 7));
}

TEST_F(DemandTest, TasksThatFitNoClassAreTold) {
  CutJob(4);
  Demand demand = Now(1, {{4 * kDemandGiB}});
  EXPECT_EQ(demand.unfit_count, 4);
  EXPECT_EQ(demand.unfit.size(), 4u);
  EXPECT_THAT(Workers(demand), ElementsAre(1)) << "the publish task fits";
  // 12 GiB fit 12 GiB; one byte less is too little.
  EXPECT_EQ(Now(1, {{12 * kDemandGiB}}).unfit_count, 0);
  EXPECT_EQ(Now(1, {{12 * kDemandGiB - 1}}).unfit_count, 4);
  // By time: the tasks take 100, 200, 300 and 400 s and must end 30 s before the limit.
  demand = Now(1, {{4 * kDemandGiB, 1, 0}, {16 * kDemandGiB, 1, 330}});
  EXPECT_EQ(demand.unfit_count, 1);
  EXPECT_THAT(Workers(demand), ElementsAre(3, 3));
  EXPECT_EQ(demand.classes[1].core_s, 600);
  demand = Now(1, {{4 * kDemandGiB, 1, 0}, {16 * kDemandGiB, 2, 230}});
  EXPECT_EQ(demand.unfit_count, 0) << "two cores take half the time";
  // A class of more time takes what the class of less time cannot.
  demand = Now(1, {{16 * kDemandGiB, 1, 330}, {32 * kDemandGiB, 1, 1000}});
  EXPECT_EQ(demand.unfit_count, 0);
  EXPECT_GE(demand.classes[1].workers, 1);
}

// Over a job's life, each class's number rises, then falls, whatever the order in which tasks end.
TEST_F(DemandTest, RisesOnceAndFalls) {
  Random random(7);
  for (const int tiles : {1, 3, 9}) {
    Create(AJob(tiles, "life " + std::to_string(tiles)));
    std::vector<std::vector<int>> history = {Workers(Now())};
    std::vector<std::string> workers;
    for (int i = 0; i < 4; ++i) workers.push_back(AnyWorker());
    std::deque<std::pair<std::string, GrantedLease>> running;
    while (true) {
      for (const std::string& worker : workers) {
        if (auto lease = Lease(worker)) running.emplace_back(worker, *std::move(lease));
        history.push_back(Workers(Now()));
      }
      if (running.empty()) break;
      const size_t which = static_cast<size_t>(random.Below(static_cast<int64_t>(running.size())));
      ASSERT_TRUE(Succeed(running[which].first, running[which].second).ok());
      running.erase(running.begin() + static_cast<std::ptrdiff_t>(which));
      history.push_back(Workers(Now()));
    }
    for (size_t i = 0; i < 2; ++i) {
      int turns = 0, highest = 0;
      bool falls = false;
      for (size_t t = 1; t < history.size(); ++t) {
        const int step = history[t][i] - history[t - 1][i];
        if (step != 0 && (step < 0) != falls) {
          falls = step < 0;
          ++turns;
        }
        highest = std::max(highest, history[t][i]);
      }
      EXPECT_LE(turns, 1) << "class " << i << ", " << tiles << " tiles";
      EXPECT_EQ(highest, tiles);
      EXPECT_EQ(history.back()[i], 0);
    }
  }
}

TEST_F(DemandTest, RestartAndRetryCountTheSame) {
  CutJob(4);
  const std::string worker = AnyWorker();
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  const Demand before = Now();
  coordinator_.reset();
  coordinator_ = *Coordinator::Open({&store_, blobs_.get(), &sized_, &clock_, {}}, options_);
  const Demand after = Now();
  EXPECT_EQ(Workers(after), Workers(before));
  EXPECT_EQ(after.classes[1].core_s, before.classes[1].core_s);
  const std::string next = AnyWorker();
  for (int i = 0; i < options_.retry.max_input; ++i) {
    clock_.Advance(options_.retry.max_delay_s);
    ASSERT_TRUE(Fail(next, *Lease(next), ErrorClass::kInput).ok());
  }
  EXPECT_EQ(Job("jobs/1").header.state, JobState::kFailed);
  EXPECT_THAT(Workers(Now()), ElementsAre(0, 0));
  ASSERT_TRUE(coordinator_->jobs().RetryJob("jobs/1", {}).ok());
  EXPECT_EQ(Workers(Now()), Workers(before));
}

}  // namespace
}  // namespace tessera
