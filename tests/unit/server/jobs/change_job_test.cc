// Changes of active jobs: priority and pause.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

using testing::HasSubstr;

class ChangeJobTest : public CoordinatorTest {
 protected:
  // The job of the worker's next task; empty: none.
  std::string JobOfLease(const std::string& worker) {
    const auto lease = Lease(worker);
    return lease ? JobName(ParseTaskName(lease->task)->job) : "";
  }
  std::string CreateWith(int priority) {
    NewJob job = AJob(2, "scene of priority " + std::to_string(priority));
    job.priority = priority;
    return Create(job);
  }
  Status Change(const std::string& job, const JobChange& change) {
    return coordinator_->jobs().ChangeJob(job, change).status();
  }
};

TEST_F(ChangeJobTest, FreeWorkerGetsTheJobOfHighestPriority) {
  const std::string low = CreateWith(-1), first = CreateWith(5), high = CreateWith(6);
  ASSERT_TRUE(Change(first, {7, {}}).ok());
  Restart();
  EXPECT_EQ(Job(first).header.priority, 7);
  const std::string worker = Worker();
  EXPECT_EQ(JobOfLease(worker), first);
  ASSERT_TRUE(Change(low, {100, {}}).ok());
  EXPECT_EQ(JobOfLease(worker), low);
  EXPECT_EQ(JobOfLease(worker), high);
  EXPECT_EQ(Task(first, 0).task.state, TaskState::kLeased) << "running tasks are not interrupted";
}

TEST_F(ChangeJobTest, PausedJobFinishesRunningTasksOnly) {
  const std::string job = Create(AJob(2));
  const std::string worker = Worker();
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  const auto running = Lease(worker);
  ASSERT_TRUE(running);
  ASSERT_TRUE(Change(job, {{}, true}).ok());
  EXPECT_FALSE(Lease(worker));
  EXPECT_TRUE(Succeed(worker, *running).ok());
  EXPECT_EQ(Job(job).tasks_done, 2);
  EXPECT_FALSE(Lease(worker));
  Restart();
  EXPECT_TRUE(Job(job).header.paused);
  const std::string other = Worker();
  EXPECT_FALSE(Lease(other));
  ASSERT_TRUE(Change(job, {3, {}}).ok()) << "the job stays paused";
  EXPECT_FALSE(Lease(other));
  ASSERT_TRUE(Change(job, {{}, false}).ok());
  EXPECT_EQ(WorkAll(other), 2);
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
}

TEST_F(ChangeJobTest, InvalidChangesAreRefused) {
  const std::string job = Create(AJob(2));
  const Status status = Change(job, {101, {}});
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("found 101, expected -100 to 100"));
  NewJob bad = AJob(2);
  bad.priority = -101;
  EXPECT_EQ(coordinator_->jobs().CreateJob(bad).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(Change("jobs/9", {1, {}}).code(), absl::StatusCode::kNotFound);
  ASSERT_TRUE(coordinator_->jobs().CancelJob(job).ok());
  EXPECT_EQ(Change(job, {{}, true}).code(), absl::StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace tessera
