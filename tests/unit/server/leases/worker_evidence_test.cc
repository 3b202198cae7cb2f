// Suspension of workers that fail tasks which other workers complete, or that cannot work at all.
#include "server/leases/worker_evidence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class WorkerEvidenceTest : public CoordinatorTest {
 protected:
  std::string SuspendedReason(const std::string& worker) {
    for (const WorkerStatus& status : coordinator_->leases().ListWorkers()) {
      if (status.name == worker) return status.suspended_reason;
    }
    return "not there";
  }
  // Both call in turn; `bad` fails each task.
  void WorkBoth(const std::string& job, const std::string& bad, ErrorClass error_class, const std::string& good) {
    for (int i = 0; i < 200 && !HasEnded(Job(job).header.state); ++i) {
      if (const auto lease = Lease(bad)) {
        ++given_to_bad_;
        ASSERT_TRUE(Fail(bad, *lease, error_class).ok());
      }
      if (const auto lease = Lease(good)) {
        ASSERT_TRUE(Succeed(good, *lease).ok());
      }
      clock_.Advance(0.1);
    }
  }
  int given_to_bad_ = 0;
};

TEST_F(WorkerEvidenceTest, UnusableScratchFolderSuspendsItsWorker) {
  const std::string job = Create(AJob(3)), full = Worker(), good = Worker();
  double wait_s = 5;
  for (int i = 0; i < 9; ++i) {
    const auto lease = Lease(full);
    ASSERT_TRUE(lease) << i;
    ASSERT_TRUE(Fail(full, *lease, ErrorClass::kScratch).ok());
    EXPECT_EQ(SuspendedReason(full), "it broke");
    clock_.Advance(wait_s - 0.1);
    EXPECT_FALSE(Lease(full));
    clock_.Advance(0.2);
    wait_s = std::min(600.0, 2 * wait_s);
  }
  EXPECT_EQ(Job(job).header.state, JobState::kRunning) << "does not count against the task";
  EXPECT_EQ(SuspendedReason(full), "");
  const auto lease = Lease(full);  // the disk has space again
  ASSERT_TRUE(lease);
  ASSERT_TRUE(Succeed(full, *lease).ok());
  const auto next = Lease(full);
  ASSERT_TRUE(next);
  ASSERT_TRUE(Fail(full, *next, ErrorClass::kScratch).ok());
  clock_.Advance(5.1);
  EXPECT_TRUE(Lease(full)) << "the delay is short again";
  WorkAll(good);
}

TEST_F(WorkerEvidenceTest, JobWaitsWhileAllWorkersAreSuspended) {
  const std::string job = Create(AJob(1)), only = Worker();
  ASSERT_TRUE(Fail(only, *Lease(only), ErrorClass::kScratch).ok());
  EXPECT_FALSE(Lease(only));
  EXPECT_EQ(Job(job).header.state, JobState::kRunning);
  clock_.Advance(6);
  WorkAll(only);
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
}

TEST_F(WorkerEvidenceTest, WorkerThatFailsTasksOthersCompleteIsSuspended) {
  for (const ErrorClass error_class : {ErrorClass::kInternal, ErrorClass::kInput, ErrorClass::kTransient}) {
    given_to_bad_ = 0;
    const std::string job = Create(AJob(6, "scene " + std::to_string(static_cast<int>(error_class))));
    const std::string bad = Worker(), good = Worker();
    WorkBoth(job, bad, error_class, good);
    EXPECT_EQ(Job(job).header.state, JobState::kSucceeded) << Job(job).header.error;
    EXPECT_LE(given_to_bad_, 4) << "of eight tasks";
    EXPECT_THAT(SuspendedReason(bad),
                AllOf(HasSubstr("it failed tasks that other workers completed"), HasSubstr("it broke")));
    EXPECT_EQ(SuspendedReason(good), "");
    ASSERT_TRUE(UnregisterAndWait(*coordinator_, bad).ok());
    ASSERT_TRUE(UnregisterAndWait(*coordinator_, good).ok());
  }
}

TEST_F(WorkerEvidenceTest, InputIsWrongIfTwoWorkersReportIt) {
  const std::string job = Create(AJob(1)), first = Worker(), second = Worker();
  ASSERT_TRUE(Fail(first, *Lease(first), ErrorClass::kInput).ok());
  EXPECT_EQ(Job(job).header.state, JobState::kRunning);
  EXPECT_FALSE(Lease(first)) << "the other worker must try it";
  ASSERT_TRUE(Fail(second, *Lease(second), ErrorClass::kInput).ok());
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
}

TEST_F(WorkerEvidenceTest, SingleWorkerMustReportWrongInputTwice) {
  const std::string job = Create(AJob(1)), only = Worker();
  ASSERT_TRUE(Fail(only, *Lease(only), ErrorClass::kInput).ok());
  EXPECT_EQ(Job(job).header.state, JobState::kRunning);
  clock_.Advance(1.1);
  ASSERT_TRUE(Fail(only, *Lease(only), ErrorClass::kInput).ok());
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
}

// For an hour no output can be stored and no transfer succeeds.
TEST_F(WorkerEvidenceTest, TasksWaitForFullStorage) {
  const std::string job = Create(AJob(2)), worker = Worker();
  int attempts = 0;
  for (int second = 0; second < 3600; ++second) {
    clock_.Advance(1);
    const auto lease = Lease(worker);
    if (!lease) continue;
    ASSERT_TRUE(Fail(worker, *lease, ++attempts % 2 == 0 ? ErrorClass::kStorage : ErrorClass::kPeer).ok());
  }
  EXPECT_EQ(Job(job).header.state, JobState::kRunning);
  EXPECT_GT(attempts, 20);
  EXPECT_LT(attempts, 200) << "the delay grows";
  clock_.Advance(61);
  WorkAll(worker);
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
}

}  // namespace
}  // namespace tessera
