// Calls that wait for a task or for durability, without a thread each.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <set>

#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

using testing::_;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

class WaitingCallsTest : public CoordinatorTest {
 protected:
  // Ends the waiting calls, which call into this object.
  ~WaitingCallsTest() override { coordinator_.reset(); }

  // Worker and reply of each answered call: the title of a task, "-" for none, or a status.
  using Answers = std::vector<std::pair<std::string, std::string>>;

  void Ask(const std::string& worker, double wait_s, const std::function<bool()>& gone = {}, int64_t call = 0) {
    coordinator_->leases().LeaseTask(
        {worker, wait_s, call, gone, [this, worker, at = coordinator_.get()](LeaseAnswer answer) {
           Note(*at, worker,
                !answer.ok() ? absl::StatusCodeToString(answer.status().code())
                : *answer    ? (*answer)->plan.name
                             : "-");
         }});
  }
  Leases::Done Noting(const std::string& who) {
    return [this, who, at = coordinator_.get()](const Status& status) {
      Note(*at, who, absl::StatusCodeToString(status.code()));
    };
  }
  void Note(Coordinator& at, const std::string& who, const std::string& what) {
    at.core().WaitForChange(0, 0);  // takes the core's mutex, which no completion may be called under
    std::lock_guard lock(mutex_);
    answers_.emplace_back(who, what);
    changed_.notify_all();
  }
  Answers Await(size_t count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return answers_.size() >= count; });
    return answers_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  Answers answers_;
};

TEST_F(WaitingCallsTest, NewTaskGoesToAWaitingWorker) {
  const std::string first = Worker(), second = Worker();
  Ask(first, 3600);
  Ask(second, 3600);
  EXPECT_THAT(Await(0), IsEmpty());
  Create(AJob(1));
  EXPECT_THAT(Await(1), ElementsAre(Pair(first, "read the scene")));
  coordinator_->core().Stop();
  EXPECT_THAT(Await(2), ElementsAre(_, Pair(second, "-")));
}

// A report starts planning even if no worker waits.
TEST_F(WaitingCallsTest, EachWaitingWorkerGetsOneTask) {
  constexpr int kCount = 300;
  const std::string planner = Worker();
  Create(AJob(kCount));
  const auto ingest = Lease(planner);
  ASSERT_TRUE(ingest);
  for (int i = 0; i < kCount; ++i) Ask(Worker(), 3600);
  coordinator_->leases().ReportSuccess(planner, ingest->task, 1, Result(*ingest), Noting("report"));
  std::set<std::string> who, what;
  for (const auto& [worker, task] : Await(kCount + 1)) {
    who.insert(worker);
    what.insert(task);
  }
  EXPECT_EQ(who.size(), size_t{kCount + 1});
  EXPECT_EQ(what.size(), size_t{kCount + 1});
  EXPECT_TRUE(what.contains("OK") && !what.contains("-"));
}

TEST_F(WaitingCallsTest, CallEndsAfterItsWait) {
  const std::string first = Worker(), second = Worker();
  Ask(first, 0.05);
  Ask(second, 0);
  EXPECT_THAT(Await(2), ElementsAre(Pair(second, "-"), Pair(first, "-")));
}

TEST_F(WaitingCallsTest, DisconnectedCallGetsNoTask) {
  const std::string first = Worker(), second = Worker(), other = Worker();
  std::atomic<bool> gone = false;
  Ask(first, 3600, [&] { return gone.load(); });
  gone = true;
  Create(AJob(1));
  EXPECT_THAT(Await(1), ElementsAre(Pair(first, "-")));
  const auto lease = Lease(other);
  ASSERT_TRUE(lease);
  EXPECT_EQ(lease->attempt, 1);
  ASSERT_TRUE(Fail(other, *lease, ErrorClass::kPreempted).ok());
  Ask(first, 3600, [] { return true; });
  EXPECT_THAT(Await(2), ElementsAre(_, Pair(first, "-"))) << "immediately";
  // CheckWaitingCall ends a disconnected call.
  ASSERT_TRUE(Lease(other));
  gone = false;
  Ask(second, 3600, [&] { return gone.load(); });
  gone = true;
  coordinator_->leases().CheckWaitingCall(second);
  coordinator_->leases().CheckWaitingCall("workers/unknown");
  EXPECT_THAT(Await(3), ElementsAre(_, _, Pair(second, "-")));
}

// A worker that repeats its call gets the task; its abandoned call gets none.
TEST_F(WaitingCallsTest, LaterCallOfAWorkerEndsTheEarlierOne) {
  const std::string worker = Worker();
  for (int i = 0; i < 3; ++i) Ask(worker, 3600, {}, 1);
  EXPECT_THAT(Await(2), ElementsAre(Pair(worker, "ABORTED"), Pair(worker, "ABORTED")));
  Create(AJob(1));
  EXPECT_THAT(Await(3), ElementsAre(_, _, Pair(worker, "read the scene")));
  Ask(worker, 3600, {}, 1);  // repeats the call
  EXPECT_THAT(Await(4), ElementsAre(_, _, _, Pair(worker, "read the scene")));
  Ask("workers/unknown", 3600);
  EXPECT_THAT(Await(5), ElementsAre(_, _, _, _, Pair("workers/unknown", "NOT_FOUND")));
}

TEST_F(WaitingCallsTest, UnregisteringEndsTheWaitingCall) {
  const std::string worker = Worker();
  Ask(worker, 3600);
  coordinator_->leases().UnregisterWorker(worker, Noting("left"));
  EXPECT_THAT(Await(2), testing::UnorderedElementsAre(Pair("left", "OK"), Pair(worker, "NOT_FOUND")));
}

TEST_F(WaitingCallsTest, StopAndDestructionEndEachWaitOnce) {
  for (int i = 0; i < 100; ++i) Ask(Worker(), 3600);
  coordinator_->core().Stop();
  Ask(Worker(), 3600);
  EXPECT_EQ(Await(101).size(), 101u);
  Restart();
  for (int i = 0; i < 100; ++i) Ask(Worker(), 3600);
  coordinator_.reset();
  const Answers answers = Await(201);
  EXPECT_EQ(answers.size(), 201u);
  for (const auto& [who, what] : answers) EXPECT_EQ(what, "-") << who;
}

// A lease that is not stored is neither granted nor lost; a report is refused until it is stored.
TEST_F(WaitingCallsTest, CallsFailIfTheirChangeIsNotStoredInTime) {
  options_.durable_wait_s = 0.3;
  Restart();
  Create(AJob(2));
  const std::string worker = Worker();
  const auto ingest = Lease(worker);
  ASSERT_TRUE(ingest);
  store_.fail = true;
  coordinator_->leases().ReportSuccess(worker, ingest->task, 1, Result(*ingest), Noting("report"));
  EXPECT_THAT(Await(1), ElementsAre(Pair("report", "UNAVAILABLE")));
  store_.fail = false;
  while (!Succeed(worker, *ingest).ok()) {
  }
  coordinator_->leases().ReportSuccess(worker, ingest->task, 1, Result(*ingest), Noting("again"));
  coordinator_->leases().ReportFailure(worker, ingest->task, 1, {ErrorClass::kInternal, "it broke"},
                                       Noting("otherwise"));
  EXPECT_THAT(Await(3), ElementsAre(_, Pair("again", "OK"), Pair("otherwise", "FAILED_PRECONDITION")));
  store_.fail = true;
  Ask(worker, 0);  // before the journal reports the failure
  EXPECT_THAT(Await(4), ElementsAre(_, _, _, Pair(worker, "UNAVAILABLE")));
  store_.fail = false;
  std::optional<GrantedLease> lease;
  while (!lease) lease = Lease(worker);
  EXPECT_EQ(lease->attempt, 2) << "the first attempt has ended";
}

TEST_F(WaitingCallsTest, LostInputsAreExaminedBesideOtherCalls) {
  const std::string job = Create(AJob(1)), worker = Worker();
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  const auto refine = Lease(worker);
  ASSERT_TRUE(refine);
  const Digest mesh = refine->inputs.at(0).file.digest;
  ASSERT_TRUE(RemoveTree(*blobs_->LocalPath(mesh)).ok());
  coordinator_->leases().ReportFailure(worker, refine->task, 1, {ErrorClass::kLostInput, "gone", {mesh}},
                                       Noting("lost"));
  EXPECT_THAT(Await(1), ElementsAre(Pair("lost", "OK")));
  const auto again = Lease(worker);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->plan.kind, "ingest");
}

// A task of a tile in a worker's memory wakes only that worker.
TEST_F(WaitingCallsTest, TaskWakesOnlyTheWorkerWithItsTile) {
  constexpr int kCount = 30;
  planner_.exchange = true;
  const std::string keeper = Worker();
  std::vector<GrantedLease> cuts;
  for (int i = 0; i < kCount; ++i) {
    Create(AJob(1, std::to_string(i)));
    ASSERT_TRUE(Succeed(keeper, *Lease(keeper)).ok());
    cuts.push_back(*Lease(keeper));
  }
  std::atomic<int> looks = 0;
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < kCount; ++i) Ask(Worker(), 3600, [&] { return ++looks < 0; });
  for (const GrantedLease& cut : cuts) ASSERT_TRUE(Succeed(keeper, cut).ok());
  ASSERT_TRUE(Lease(keeper));  // and leaves other tasks
  const int at_last = looks;
  // The others try from time to time.
  const int times = static_cast<int>((std::chrono::steady_clock::now() - start) / std::chrono::milliseconds(500));
  EXPECT_LT(at_last, kCount * (1 + times) + kCount / 2);
}

// Another job runs the same task meanwhile.
TEST_F(WaitingCallsTest, TaskWithAResultFoundMeanwhileIsNotLeased) {
  Create(AJob(1));
  const std::string first = Worker(), second = Worker();
  const auto ingest = Lease(first);
  ASSERT_TRUE(ingest);
  const std::string job = Create(AJob(1));
  ASSERT_TRUE(Succeed(first, *ingest).ok());
  ASSERT_TRUE(Lease(first));  // the first job's next task
  Ask(second, 3600);
  EXPECT_THAT(Await(1), ElementsAre(Pair(second, "refine tile 0")));
  EXPECT_TRUE(Task(job, 0).task.reused);
}

}  // namespace
}  // namespace tessera
