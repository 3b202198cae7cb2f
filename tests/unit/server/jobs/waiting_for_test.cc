// The reason why a job makes no progress, and placement of tasks by memory.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

constexpr int64_t kGiB = int64_t{1} << 30;

class LargePlanner : public FakePlanner {
 public:
  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>& files, const UpdateBase* base) override {
    auto tasks = FakePlanner::Tiles(settings, survey, files, base);
    for (PlannedTask& task : *tasks) task.peak_bytes = task.kind == "refine" ? 12 * kGiB : 1 * kGiB;
    return tasks;
  }
};

class WaitingForTest : public CoordinatorTest {
 protected:
  WaitingForTest() { coordinator_ = *Coordinator::Open({&store_, blobs_.get(), &large_, &clock_, {}}, options_); }
  std::string WorkerWith(int64_t gib) {
    return *coordinator_->leases().RegisterWorker({"host", 1, 2, gib * kGiB, 0, "host/boot"});
  }
  std::string Why(const std::string& job) { return Job(job).waiting_for; }
  LargePlanner large_;
};

TEST_F(WaitingForTest, NamesWorkersDelaysTasksPausesAndOtherJobs) {
  const std::string job = Create(AJob(1));
  EXPECT_EQ(Why(job), "no worker is registered");
  const std::string worker = WorkerWith(16);
  EXPECT_EQ(Why(job), "") << "about to be leased";
  const auto lease = Lease(worker);
  clock_.Advance(20);
  EXPECT_EQ(Why(job), "waiting for 'read the scene', on host for 20 s");
  const std::string second = Create(AJob(1, "second"));
  EXPECT_EQ(Why(second), "the only worker is busy");
  ASSERT_TRUE(Fail(worker, *lease, ErrorClass::kTransient).ok());
  clock_.Advance(0.1);
  EXPECT_EQ(Why(job), "'read the scene' is retried in 1 s, after: it broke");
  clock_.Advance(1);
  LeaseAndWait(*coordinator_, WorkerWith(1), 0, {}).status().IgnoreError();  // the call ends the delay
  EXPECT_EQ(Why(second), "");
  const std::string third = Create(AJob(1, "third"));
  EXPECT_EQ(Why(third), second + ", an older job, goes first");
  ASSERT_TRUE(coordinator_->jobs().ChangeJob(third, {7, {}}).ok());
  EXPECT_EQ(Why(second), third + ", of priority 7, goes first");
  ASSERT_TRUE(coordinator_->jobs().ChangeJob(third, {{}, true}).ok());
  EXPECT_EQ(Why(third), "paused");
  EXPECT_EQ(Why(second), "");
  ASSERT_TRUE(coordinator_->jobs().CancelJob(second).ok());
  EXPECT_EQ(Why(second), "");
}

TEST_F(WaitingForTest, AllWorkersSuspended) {
  const std::string job = Create(AJob(1)), worker = WorkerWith(16);
  ASSERT_TRUE(Fail(worker, *Lease(worker), ErrorClass::kScratch).ok());
  EXPECT_EQ(Why(job), "the only worker is suspended: it broke");
  clock_.Advance(options_.retry.suspend_s + 1);
  EXPECT_EQ(Why(job), "");
}

TEST_F(WaitingForTest, TaskTooLargeForAllWorkersFinallyRunsOnTheLargest) {
  const std::string job = Create(AJob(2));
  const std::string small = WorkerWith(4), larger = WorkerWith(8);
  ASSERT_TRUE(Succeed(small, *Lease(small)).ok());
  EXPECT_FALSE(Lease(small));
  EXPECT_FALSE(Lease(larger));
  EXPECT_EQ(Why(job),
            "no worker has 12.0 GiB for 'refine tile 1': the largest has 8.0 GiB, and gets it in 60 s unless a larger "
            "one registers");
  clock_.Advance(61);
  EXPECT_FALSE(Lease(small)) << "not the largest worker";
  const auto tried = Lease(larger);
  ASSERT_TRUE(tried);
  EXPECT_EQ(tried->plan.name, "refine tile 1");
  const std::string enough = WorkerWith(12);
  EXPECT_FALSE(Lease(larger)) << "a worker with enough memory is registered";
  const auto lease = Lease(enough);
  ASSERT_TRUE(lease);
  EXPECT_EQ(lease->plan.name, "refine tile 0");
}

TEST_F(WaitingForTest, OtherTasksRunWhileOneWaitsForALargerWorker) {
  const std::string large = Create(AJob(1)), worker = WorkerWith(8);
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  EXPECT_FALSE(Lease(worker));
  const std::string next = Create(AJob(1, "next"));
  const auto lease = Lease(worker);
  ASSERT_TRUE(lease);
  EXPECT_EQ(JobName(ParseTaskName(lease->task)->job), next);
}

}  // namespace
}  // namespace tessera
