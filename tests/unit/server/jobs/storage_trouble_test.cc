// A coordinator that temporarily cannot store records.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <future>
#include <utility>

#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class StorageTroubleTest : public CoordinatorTest {};

// While the disk is full or a backup locks the database, no call returns OK and leasing is suspended.
TEST_F(StorageTroubleTest, UnstoredChangesAreNotAcknowledgedAndNotLost) {
  options_.durable_wait_s = 0.3;
  Restart();
  const std::string job = Create(AJob(2));
  const std::string worker = Worker();
  const auto lease = Lease(worker);
  ASSERT_TRUE(lease);
  store_.fail = true;
  EXPECT_EQ(Succeed(worker, *lease).code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(coordinator_->core().journal().trouble().message(), HasSubstr("disk full"));
  NewJob second = AJob(1, "other");
  second.request = {"request", "/scene", {}};
  const auto refused = coordinator_->jobs().CreateJob(second);
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(refused.status().message(), HasSubstr("disk full"));
  EXPECT_EQ(coordinator_->jobs().CreateJob(second).status().code(), absl::StatusCode::kUnavailable);
  EXPECT_FALSE(Lease(worker));
  EXPECT_THAT(*coordinator_->leases().Heartbeat(worker, {}), IsEmpty());
  store_.fail = false;
  while (!Succeed(worker, *lease).ok()) {  // repeats the report until it is accepted
  }
  EXPECT_EQ(coordinator_->jobs().CreateJob(second)->header.name, "jobs/2");
  EXPECT_TRUE(coordinator_->core().journal().trouble().ok());
  options_ = {};
  Restart();
  EXPECT_EQ(coordinator_->jobs().ListJobs(-1, 10).size(), 2u);
  EXPECT_EQ(WorkAll(Worker()), 3 + 3);
}

// A change that never reached the disk has no effect after a restart.
TEST_F(StorageTroubleTest, UnacknowledgedChangesMayBeLost) {
  options_.durable_wait_s = 0.05;
  Restart();
  const std::string job = Create(AJob(1));
  const auto lease = Lease(Worker());
  store_.fail = true;
  EXPECT_FALSE(Succeed(coordinator_->leases().ListWorkers().at(0).name, *lease).ok());
  coordinator_.reset();
  store_.fail = false;
  Restart();
  EXPECT_EQ(Task(job, 0).task.state, TaskState::kLeased);
  clock_.Advance(31);
  EXPECT_EQ(WorkAll(Worker()), 3);
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
}

// Before the journal reports a failure, a lease may be committed; it waits to be stored like all records.
TEST_F(StorageTroubleTest, UnstoredLeaseDoesNotExpire) {
  const std::string job = Create(AJob(1)), worker = Worker();
  std::promise<LeaseAnswer> told;
  const auto ask = [&](std::promise<LeaseAnswer>& answer) {
    coordinator_->leases().LeaseTask(
        {worker, 0, 7, {}, [&](LeaseAnswer given) { answer.set_value(std::move(given)); }});
  };
  store_.fail = true;
  ask(told);
  ASSERT_EQ(Task(job, 0).task.state, TaskState::kLeased);
  clock_.Advance(3600);  // longer than a lease and than the stall limit
  ASSERT_TRUE(coordinator_->Tick().ok());
  EXPECT_EQ(Task(job, 0).task.state, TaskState::kLeased);
  store_.fail = false;
  const LeaseAnswer lease = told.get_future().get();
  ASSERT_TRUE(lease.ok() && *lease) << lease.status();
  clock_.Advance(29);
  ASSERT_TRUE(coordinator_->Tick().ok());
  EXPECT_EQ(Task(job, 0).task.state, TaskState::kLeased);
  // The repeated call starts the term of the lease, which then expires.
  std::promise<LeaseAnswer> again;
  ask(again);
  EXPECT_EQ((*again.get_future().get())->attempt, 1);
  clock_.Advance(29);
  ASSERT_TRUE(coordinator_->Tick().ok());
  EXPECT_EQ(Task(job, 0).task.state, TaskState::kLeased);
  clock_.Advance(2);
  ASSERT_TRUE(coordinator_->Tick().ok());
  EXPECT_NE(Task(job, 0).task.state, TaskState::kLeased);
}

// Lists of jobs do not wait for the disk and show no state that may be lost.
TEST_F(StorageTroubleTest, UnstoredEndIsNotListed) {
  options_.durable_wait_s = 0.05;
  Restart();
  const std::string cancelled = Create(AJob(1)), done = Create(AJob(1, "other"));
  const std::string worker = Worker();
  ASSERT_TRUE(coordinator_->jobs().ChangeJob(cancelled, {{}, true}).ok());
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  const auto publish = Lease(worker);
  store_.fail = true;
  EXPECT_FALSE(Succeed(worker, *publish).ok());
  EXPECT_FALSE(coordinator_->jobs().CancelJob(cancelled).ok());
  const auto states = [&] {
    std::vector<JobState> listed;
    for (const JobStatus& job : coordinator_->jobs().ListJobs(-1, 10)) listed.push_back(job.header.state);
    return listed;
  };
  EXPECT_THAT(states(), ElementsAre(JobState::kRunning, JobState::kQueued));
  EXPECT_THAT(coordinator_->jobs().ListJobs(-1, 10).at(0).artifacts, IsEmpty());
  EXPECT_EQ(coordinator_->jobs().ListJobs(-1, 10).at(1).waiting_for, "the end of the job is not stored yet");
  store_.fail = false;
  while (!coordinator_->core().Durable().ok()) {  // waits for 0.05 s
  }
  EXPECT_THAT(states(), ElementsAre(JobState::kSucceeded, JobState::kCancelled));
  EXPECT_EQ(Job(done).header.state, JobState::kSucceeded);
}

}  // namespace
}  // namespace tessera
