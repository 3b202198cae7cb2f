// The reason why a job makes no progress, and placement of tasks by memory and by the workers' time limits.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

constexpr int64_t kGiB = int64_t{1} << 30;

class LargePlanner : public FakePlanner {
 public:
  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>& files, const UpdateBase* base,
                                           const FinePart* fine) override {
    auto tasks = FakePlanner::Tiles(settings, survey, files, base, fine);
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

// Refine tasks of tile 0 and 1 take 300 and 600 s on a worker's two threads.
class SlowPlanner : public FakePlanner {
 public:
  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>& files, const UpdateBase* base,
                                           const FinePart* fine) override {
    auto tasks = FakePlanner::Tiles(settings, survey, files, base, fine);
    for (PlannedTask& task : *tasks) {
      task.cost *= 600;
      if (task.kind == "refine") task.peak_bytes = peak_bytes;
    }
    return tasks;
  }
  int64_t peak_bytes = 0;
};

class TimeLimitTest : public CoordinatorTest {
 protected:
  TimeLimitTest() {
    coordinator_ = *Coordinator::Open({&store_, blobs_.get(), &slow_, &clock_, {}}, options_);
    const std::string job = Create(AJob(2)), worker = WorkerFor(0);
    EXPECT_TRUE(Succeed(worker, *Lease(worker)).ok());
    EXPECT_TRUE(coordinator_->leases().HandleUnregister(worker).ok());
  }
  // 0: no limit.
  std::string WorkerFor(double seconds, int64_t gib = 0) {
    WorkerInfo info = {"host", 1, 2, gib * kGiB, 0, "host/boot/" + std::to_string(next_allocation_++)};
    info.time_left_s = seconds;
    return *coordinator_->leases().RegisterWorker(info);
  }
  std::string NameOf(const std::optional<GrantedLease>& lease) { return lease ? lease->plan.name : ""; }
  SlowPlanner slow_;
  int next_allocation_ = 1;
};

TEST_F(TimeLimitTest, WorkerGetsWhatEndsBeforeItsAllocation) {
  const std::string worker = WorkerFor(331), free = WorkerFor(0);
  EXPECT_EQ(NameOf(Lease(worker)), "refine tile 0") << "the first task in the order, of tile 1, takes too long";
  EXPECT_EQ(NameOf(Lease(free)), "refine tile 1");
}

TEST_F(TimeLimitTest, TimePasses) {
  const std::string worker = WorkerFor(631), other = WorkerFor(0);
  clock_.Advance(2);
  EXPECT_EQ(NameOf(Lease(worker)), "refine tile 0");
  EXPECT_EQ(coordinator_->leases().ListWorkers().at(0).time_left_s, 629);
  EXPECT_EQ(coordinator_->leases().ListWorkers().at(1).time_left_s, std::nullopt);
}

TEST_F(TimeLimitTest, WhatFitsNobodyGoesToTheLongestAndIsTold) {
  const std::string shorter = WorkerFor(200), longer = WorkerFor(250);
  EXPECT_FALSE(Lease(shorter));
  EXPECT_FALSE(Lease(longer));
  EXPECT_EQ(
      Job("jobs/1").waiting_for,
      "no worker has the time for 'refine tile 1', which takes about 10 min and must end 30 s before the worker's "
      "time limit: the longest has 4 min left, and gets it after 30 s without another task unless one with more "
      "time registers");
  clock_.Advance(29);
  EXPECT_FALSE(Lease(longer));
  clock_.Advance(2);
  EXPECT_FALSE(Lease(shorter)) << "another worker has more time left";
  EXPECT_EQ(NameOf(Lease(longer)), "refine tile 1");
  EXPECT_FALSE(Lease(longer)) << "the wait starts again";
  const std::string enough = WorkerFor(0);
  clock_.Advance(61);
  EXPECT_FALSE(Lease(longer)) << "another worker has enough time";
  EXPECT_EQ(NameOf(Lease(enough)), "refine tile 0");
}

TEST_F(TimeLimitTest, TimeOfWorkersWithTooLittleMemoryDoesNotCount) {
  slow_.peak_bytes = 12 * kGiB;
  Create(AJob(1, "large"));
  const std::string small = WorkerFor(0, 4), large = WorkerFor(200, 16);
  ASSERT_TRUE(coordinator_->jobs().CancelJob("jobs/1").ok());
  ASSERT_TRUE(Succeed(small, *Lease(small)).ok());
  EXPECT_FALSE(Lease(small));
  EXPECT_FALSE(Lease(large));
  clock_.Advance(61);
  EXPECT_EQ(NameOf(Lease(large)), "refine tile 0");
}

}  // namespace
}  // namespace tessera
