// Attempts that end early: what they count against, and when the next one starts.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/base/refusal.h"
#include "server/jobs/coordinator.h"
#include "tessera/v1/records.pb.h"
#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

using LostAttemptsTest = CoordinatorTest;

// A change of the system time does not change delays.
TEST_F(LostAttemptsTest, DelaysDoNotFollowTheSystemClock) {
  Create(AJob(1));
  const std::string worker = Worker();
  ASSERT_TRUE(Fail(worker, *Lease(worker), ErrorClass::kTransient).ok());
  clock_.SetBy(-3600);
  clock_.Advance(0.9);
  EXPECT_FALSE(Lease(worker));
  clock_.Advance(0.2);
  const auto second = Lease(worker);
  ASSERT_TRUE(second);
  ASSERT_TRUE(Fail(worker, *second, ErrorClass::kTransient).ok());
  clock_.SetBy(+7200);
  EXPECT_FALSE(Lease(worker)) << "2 s have not passed";
  // A restart starts the delay again.
  clock_.Advance(1.5);
  Restart();
  clock_.SetBy(-7200);
  const std::string other = Worker();
  clock_.Advance(1.9);
  EXPECT_FALSE(Lease(other));
  clock_.Advance(0.2);
  EXPECT_TRUE(Lease(other));
}

TEST_F(LostAttemptsTest, DelaysOfEarlierReleasesAreRead) {
  Create(AJob(1));
  const std::string worker = Worker();
  ASSERT_TRUE(Fail(worker, *Lease(worker), ErrorClass::kTransient).ok());
  v1::Record record;
  ASSERT_TRUE(record.ParseFromString(store_.records.back()));
  ASSERT_EQ(record.attempt_failed().retry_delay_us(), 1'000'000);
  record.mutable_attempt_failed()->clear_retry_delay_us();
  record.mutable_attempt_failed()->set_retry_time_us(record.time_us() + 1'000'000);
  store_.records.back() = record.SerializeAsString();
  clock_.SetBy(-3600);
  Restart();
  const std::string other = Worker();
  EXPECT_FALSE(Lease(other));
  clock_.Advance(1);
  EXPECT_TRUE(Lease(other));
}

// A tile that kills its workers: their machines stay alive and restart them.
TEST_F(LostAttemptsTest, ThreeDeadWorkersOnLiveMachinesMakeATaskPoison) {
  const std::string job = Create(AJob(1));
  for (int i = 0; i < 3; ++i) {
    ASSERT_EQ(Job(job).header.state, i == 0 ? JobState::kQueued : JobState::kRunning);
    ASSERT_TRUE(Lease(Worker())) << i;
    clock_.Advance(31);
    Worker();
    ASSERT_TRUE(coordinator_->Tick().ok());
  }
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_EQ(Task(job, 0).task.error->error_class, ErrorClass::kPoison);
  EXPECT_THAT(Job(job).header.error, HasSubstr("fell silent during 'read the scene': the task lost 3 workers on live"));
}

// A coordinator that restarts repeatedly during one task, before the task's worker can call it.
TEST_F(LostAttemptsTest, WorkersLostInRestartsDoNotCountAgainstTheTask) {
  const std::string job = Create(AJob(1));
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(Lease(Worker())) << i;
    Restart();
    clock_.Advance(31);
    Worker();  // the machine is alive
    ASSERT_TRUE(coordinator_->Tick().ok());
    EXPECT_EQ(Task(job, 0).task.state, TaskState::kReady);
    EXPECT_EQ(Task(job, 0).task.error->error_class, ErrorClass::kPreempted);
  }
  // A worker that calls and then falls silent counts.
  for (int i = 0; i < 3; ++i) {
    ASSERT_EQ(Job(job).header.state, JobState::kRunning);
    const std::string worker = Worker();
    ASSERT_TRUE(Lease(worker));
    Restart();
    ASSERT_TRUE(coordinator_->leases().Heartbeat(worker, {}).ok());
    clock_.Advance(31);
    Worker();
    ASSERT_TRUE(coordinator_->Tick().ok());
  }
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_EQ(Task(job, 0).task.error->error_class, ErrorClass::kPoison);
}

// A suspended coordinator receives no calls. Afterwards the lease has as much time left as before.
TEST_F(LostAttemptsTest, SuspensionOfTheCoordinatorDoesNotCountAsSilence) {
  options_.max_check_gap_s = 15;
  Restart();
  const std::string job = Create(AJob(1));
  const std::string worker = Worker();
  ASSERT_TRUE(Lease(worker));
  clock_.Advance(10);
  ASSERT_TRUE(coordinator_->Tick().ok());
  clock_.Advance(2 * 3600);
  ASSERT_TRUE(coordinator_->Tick().ok());
  clock_.Advance(14);
  ASSERT_TRUE(coordinator_->Tick().ok());
  EXPECT_EQ(Task(job, 0).task.state, TaskState::kLeased) << "24 s of 30 have passed";
  clock_.Advance(7);
  ASSERT_TRUE(coordinator_->Tick().ok());
  EXPECT_EQ(Task(job, 0).task.state, TaskState::kReady) << "31 s of silence";
}

// Spot machines: some vanish, some unregister, one comes back after a reboot, all during one task.
TEST_F(LostAttemptsTest, VanishedMachinesDoNotCountAgainstTheTask) {
  const std::string job = Create(AJob(1));
  for (int i = 0; i < 30; ++i) {
    const std::string worker = Worker("spot/" + std::to_string(i));
    const auto lease = Lease(worker);
    ASSERT_TRUE(lease) << i;
    if (i % 3 == 0) {
      ASSERT_TRUE(UnregisterAndWait(*coordinator_, worker).ok());
    } else if (i % 3 == 1) {
      ASSERT_TRUE(Fail(worker, *lease, ErrorClass::kPreempted).ok());
    } else {
      // Two workers of one machine; the other one called last.
      const std::string other = Worker("spot/" + std::to_string(i));
      clock_.Advance(1);
      ASSERT_TRUE(coordinator_->leases().Heartbeat(other, {}).ok());
      clock_.Advance(30);
      ASSERT_TRUE(coordinator_->Tick().ok());
      if (i == 14) Restart();
    }
    ASSERT_EQ(Job(job).header.state, JobState::kRunning) << i;
  }
  WorkAll(Worker());
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
}

// A scheduler takes allocations of a host away while others of it live.
TEST_F(LostAttemptsTest, VanishedAllocationsOfALiveHostDoNotCountAgainstTheTask) {
  const std::string job = Create(AJob(1));
  const std::string other = Worker("host/boot/900");
  for (int i = 0; i < 10; ++i) {
    ASSERT_TRUE(Lease(Worker("host/boot/" + std::to_string(i)))) << i;
    clock_.Advance(31);
    ASSERT_TRUE(coordinator_->leases().Heartbeat(other, {}).ok());
    ASSERT_TRUE(coordinator_->Tick().ok());
    ASSERT_EQ(Job(job).header.state, JobState::kRunning) << i;
  }
  WorkAll(other);
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
}

TEST_F(LostAttemptsTest, StalledAttemptEndsDespiteHeartbeats) {
  const std::string job = Create(AJob(1));
  const std::string hung = Worker();
  const auto lease = Lease(hung);
  ASSERT_TRUE(lease);
  const auto beat = [&](double progress, const std::string& stage) {
    clock_.Advance(20);
    EXPECT_TRUE(coordinator_->Tick().ok());
    return *coordinator_->leases().Heartbeat(hung, {{lease->task, 1, progress, stage}});
  };
  for (int i = 0; i < 60; ++i) ASSERT_THAT(beat(0.01 * (i / 20), "reading"), IsEmpty()) << "progress every 400 s";
  for (int i = 0; i < 20; ++i) ASSERT_THAT(beat(0.02, "checking " + std::to_string(i / 10)), IsEmpty());
  for (int i = 0; i < 21; ++i) ASSERT_THAT(beat(0.02, "checking 1"), IsEmpty());
  const std::string other = Worker();
  EXPECT_FALSE(Lease(other));
  EXPECT_THAT(beat(0.02, "checking 1"), ElementsAre(lease->task));
  EXPECT_EQ(Task(job, 0).task.error->message,
            "stalled: " + hung + " showed no progress for 600 s, at 2 % (checking 1)");
  clock_.Advance(1.1);
  const auto again = Lease(other);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->attempt, 2);
  EXPECT_EQ(Succeed(hung, *lease).code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_TRUE(Succeed(other, *again).ok());
}

// The records have the worker's name and machine alone, so its memory, cores and time limit are not known.
TEST_F(LostAttemptsTest, WorkerRegistersAgainForItsNextTaskAfterARestart) {
  Create(AJob(2));
  const std::string worker = Worker();
  const auto lease = Lease(worker);
  Restart();
  ASSERT_TRUE(Succeed(worker, *lease).ok()) << "the lease holds";
  const auto next = LeaseAndWait(*coordinator_, worker, 0, {});
  EXPECT_EQ(RefusalOf(next.status()), Refusal::kUnknownWorker);
  const std::string again = Worker();
  EXPECT_TRUE(Lease(again));
}

}  // namespace
}  // namespace tessera
