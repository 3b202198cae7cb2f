// The blob store may answer late: calls of workers never wait for it.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/retention/reclaimer.h"
#include "tests/support/checking_worker.h"
#include "tests/support/watched_blobs.h"

namespace tessera {
namespace {

using testing::IsEmpty;

class StoreCallsTest : public CheckingWorkerTest {
 protected:
  StoreCallsTest() { OpenWatched(); }
  ~StoreCallsTest() override {
    watched_.Release();
    coordinator_.reset();
  }

  void OpenWatched() {
    coordinator_.reset();
    watched_.Watch(nullptr);
    coordinator_ = *Coordinator::Open({&store_, &watched_, &planner_, &clock_, {}}, options_);
    watched_.Watch(&coordinator_->core().mutex());
  }
  NewJob OfPriority(NewJob job, int priority) {
    job.priority = priority;
    return job;
  }
  NewJob OfOtherContent(NewJob job) {
    job.scene_files = AJob(1, "{\"other\":1}").scene_files;
    return job;
  }
  void AwaitEnd(const std::string& job) {
    for (int times = 0; times < 20 && !HasEnded(Job(job).header.state); ++times) {
      const int64_t seen = coordinator_->core().WaitForChange(0, 0);
      if (!HasEnded(Job(job).header.state)) coordinator_->core().WaitForChange(seen, 1);
    }
  }

  // The result of a call that is made in a thread of its own and counts as one that answers callers. A call that does
  // not return within 20 s fails the test, and ends when the store is released.
  template <class T>
  T Answered(const std::function<T()>& call, const std::string& what) {
    auto answer = std::async(std::launch::async, [&] {
      const WatchedBlobs::Answering answering;
      return call();
    });
    if (answer.wait_for(std::chrono::seconds(20)) != std::future_status::ready) {
      ADD_FAILURE() << what << " waits for the blob store";
      watched_.Release();
    }
    return answer.get();
  }
  Status Report(const std::string& worker, const GrantedLease& lease) {
    const ReportedResult result = Made(lease);
    const auto done = std::make_shared<std::promise<Status>>();
    Answered<bool>(
        [&] {
          coordinator_->leases().ReportSuccess(worker, lease.task, lease.attempt, result,
                                               [done](const Status& status) { done->set_value(status); });
          return true;
        },
        "a report");
    return Get(done->get_future(), "the answer to a report");
  }
  std::future<LeaseAnswer> Ask(const std::string& worker, double wait_s) {
    const auto answer = std::make_shared<std::promise<LeaseAnswer>>();
    Answered<bool>(
        [&] {
          coordinator_->leases().LeaseTask(
              {worker, wait_s, 0, {}, [answer](LeaseAnswer given) { answer->set_value(std::move(given)); }});
          return true;
        },
        "a call for a task");
    return answer->get_future();
  }
  std::optional<GrantedLease> LeaseFrom(const std::string& worker, double wait_s = 0) {
    const LeaseAnswer answer = Get(Ask(worker, wait_s), "the answer to a call for a task");
    EXPECT_TRUE(answer.ok()) << answer.status();
    return answer.ok() ? *answer : std::nullopt;
  }
  bool Beats(const std::string& worker, const GrantedLease& lease) {
    const std::vector<ReportedProgress> running = {{lease.task, lease.attempt, 0.5, "half"}};
    const auto stop = Answered<StatusOr<std::vector<std::string>>>(
        [&] { return coordinator_->leases().Heartbeat(worker, running); }, "a heartbeat");
    return stop.ok() && stop->empty();
  }
  template <class T>
  T Get(std::future<T> answer, const std::string& what) {
    if (answer.wait_for(std::chrono::seconds(20)) != std::future_status::ready) {
      ADD_FAILURE() << what << " waits for the blob store";
      watched_.Release();
    }
    return answer.get();
  }

  WatchedBlobs watched_{blobs_.get()};
};

TEST_F(StoreCallsTest, WorkersGoOnWhileNoStoreCallReturns) {
  const std::string job = Create(Scene(3)), workers[] = {Worker(), Worker(), Worker()};
  ASSERT_TRUE(Report(workers[0], *LeaseFrom(workers[0])).ok());
  const auto first = LeaseFrom(workers[0], 3600), second = LeaseFrom(workers[1], 3600);
  ASSERT_TRUE(first && second);
  watched_.Hold();
  EXPECT_TRUE(Report(workers[0], *first).ok());
  EXPECT_TRUE(Beats(workers[1], *second));
  const auto third = LeaseFrom(workers[2], 3600);
  ASSERT_TRUE(third);
  EXPECT_TRUE(Report(workers[2], *third).ok());
  EXPECT_TRUE(Report(workers[1], *second).ok());
  const auto publish = LeaseFrom(workers[0], 3600);
  ASSERT_TRUE(publish);
  EXPECT_TRUE(Report(workers[0], *publish).ok());
  watched_.Release();
  AwaitEnd(job);
  Mesh(job);
}

// Known results of the first job in the order are checked; tasks of later jobs are leased and reported meanwhile.
TEST_F(StoreCallsTest, KnownResultsAreCheckedBesideOtherTasks) {
  Work(Create(Scene(3)));
  Create(OfOtherContent(Scene(1)));
  watched_.Hold();
  auto created =
      std::async(std::launch::async, [&] { return coordinator_->jobs().CreateJob(OfPriority(Scene(3), 9)); });
  ASSERT_TRUE(watched_.AwaitHeld(1));
  const std::string worker = Worker();
  const auto lease = LeaseFrom(worker);
  ASSERT_TRUE(lease);
  EXPECT_EQ(lease->task, "jobs/2/tasks/0");
  EXPECT_TRUE(Beats(worker, *lease));
  EXPECT_TRUE(Report(worker, *lease).ok());
  watched_.Release();
  const auto status = created.get();
  ASSERT_TRUE(status.ok()) << status.status();
  EXPECT_EQ(Job(status->header.name).header.state, JobState::kSucceeded);
  EXPECT_TRUE(Task(status->header.name, 3).task.reused);
}

// A ready task whose result another job stores meanwhile: its check must not keep a waiting worker from other tasks.
TEST_F(StoreCallsTest, ResultThatIsFoundLateIsCheckedBesideOtherTasks) {
  const std::string workers[] = {Worker(), Worker(), Worker()};
  const std::string first = Create(Scene(1));
  const auto ingest = LeaseFrom(workers[0]);
  const std::string second = Create(OfPriority(Scene(1), 9));
  const std::string third = Create(OfOtherContent(Scene(1)));
  ASSERT_TRUE(Succeed(workers[0], *ingest).ok());
  watched_.Hold();
  auto refine = Ask(workers[0], 3600);
  const auto lease = LeaseFrom(workers[1], 3600);
  ASSERT_TRUE(lease);
  std::optional<GrantedLease> another = *Get(std::move(refine), "the answer to a call for a task");
  ASSERT_TRUE(another);
  EXPECT_THAT(std::vector({lease->task, another->task}),
              testing::UnorderedElementsAre(first + "/tasks/1", third + "/tasks/0"));
  watched_.Release();
  const auto reader = LeaseFrom(workers[2], 3600);
  ASSERT_TRUE(reader);
  EXPECT_EQ(reader->task, second + "/tasks/1");
  EXPECT_TRUE(Task(second, 0).task.reused);
}

TEST_F(StoreCallsTest, LeasesEndWhileNoStoreCallReturns) {
  Create(Scene(2));
  const std::string other = Create(OfOtherContent(Scene(2))), workers[] = {Worker(), Worker()};
  const auto first = LeaseFrom(workers[0]), second = LeaseFrom(workers[1]);
  ASSERT_TRUE(first && second);
  watched_.Hold();
  EXPECT_TRUE(Report(workers[0], *first).ok());
  const auto tick = [&] { return Answered<Status>([&] { return coordinator_->TickInBackground(); }, "a tick").ok(); };
  EXPECT_TRUE(tick());
  ASSERT_TRUE(watched_.AwaitHeld(1)) << "the survey is read";
  clock_.Advance(options_.lease_s + 1);
  EXPECT_TRUE(tick());
  EXPECT_EQ(Task(other, 0).task.state, TaskState::kReady);
  clock_.Advance(options_.forget_worker_s + 1);
  EXPECT_TRUE(tick());
  EXPECT_THAT(coordinator_->leases().ListWorkers(), IsEmpty());
}

TEST_F(StoreCallsTest, NoCallIsMadeByAnsweringThreadsOrUnderTheMutex) {
  planner_.exchange = true;
  const std::string job = Create(Scene(3)), worker = Worker();
  int leases = 0;
  for (int turn = 0; turn < 200 && !HasEnded(Job(job).header.state); ++turn) {
    const auto lease = LeaseFrom(worker, 0.2);
    if (!lease) continue;
    EXPECT_TRUE(Beats(worker, *lease));
    if (++leases == 4) {  // a false report of a lost input is examined, too
      const auto done = std::make_shared<std::promise<Status>>();
      const TaskFailure lost{ErrorClass::kLostInput, "lost", {lease->inputs.at(0).file.digest}};
      Answered<bool>(
          [&] {
            coordinator_->leases().ReportFailure(worker, lease->task, lease->attempt, lost,
                                                 [done](const Status& status) { done->set_value(status); });
            return true;
          },
          "a report");
      EXPECT_TRUE(Get(done->get_future(), "the answer to a report").ok());
      clock_.Advance(61);
      continue;
    }
    EXPECT_TRUE(Report(worker, *lease).ok());
  }
  Mesh(job);
  Create(Scene(3));
  EXPECT_GT(watched_.calls(), 0);
  EXPECT_EQ(watched_.calls_while_answering(), 0);
  EXPECT_EQ(watched_.calls_under_mutex(), 0);
}

TEST_F(StoreCallsTest, KnownResultsAreCheckedManyAtOnce) {
  Work(Create(Scene(40)));
  const int before = watched_.calls();
  watched_.Hold(3);  // both outputs of the first task are found, and its survey is read
  auto created = std::async(std::launch::async, [&] { return coordinator_->jobs().CreateJob(Scene(40)); });
  EXPECT_TRUE(watched_.AwaitHeld(BlobStore::kCallsAtOnce));
  watched_.Release();
  ASSERT_TRUE(created.get().ok());
  EXPECT_EQ(watched_.most_at_once(), BlobStore::kCallsAtOnce);
  EXPECT_LE(watched_.calls() - before, 42 + 1 + 10) << "the outputs of 42 tasks, and some calls to plan and to report";
}

// Results that a job could reuse are gone: each task is computed once, and no attempt fails.
TEST_F(StoreCallsTest, ManyResultsThatAreGoneAreComputedAgain) {
  constexpr int kTiles = 60;
  const std::string first = Create(Scene(kTiles)), worker = Worker();
  while (Turn(worker)) {
  }
  const Digest mesh = Mesh(first);
  for (const std::string& path : Blobs()) ASSERT_TRUE(RemoveTree(path).ok());
  const std::string again = Create(Scene(kTiles));
  int turns = 0;
  while (Turn(worker)) ++turns;
  EXPECT_EQ(turns, kTiles + 2) << "each task once";
  EXPECT_EQ(Mesh(again), mesh);
  for (int task = 0; task < kTiles + 2; ++task) ASSERT_EQ(Task(again, task).task.attempt(), 1) << task;
}

// The store does not answer whether the blobs exist, so known results are used. All blobs are gone, which their readers
// find.
TEST_F(StoreCallsTest, ManyReusedResultsThatAreGoneAreMadeAgainWhenRead) {
  constexpr int kTiles = 60;
  const std::string first = Create(Scene(kTiles)), worker = Worker();
  while (Turn(worker)) {
  }
  const Digest mesh = Mesh(first);
  for (const std::string& path : Blobs()) ASSERT_TRUE(RemoveTree(path).ok());
  watched_.AnswerStatsWith(absl::UnavailableError("the store does not answer"));
  const std::string again = Create(Scene(kTiles));
  // The coordinator itself reads the survey to plan the tiles, so ingest is the first to be made again.
  int turns = 0;
  while (Turn(worker) && turns < 10 * kTiles) ++turns;
  EXPECT_EQ(Mesh(again), mesh);
  watched_.AnswerStatsWith(absl::OkStatus());
  ASSERT_TRUE(coordinator_->recovery().RemakeArtifact(mesh).ok());
  ASSERT_TRUE(coordinator_->Tick().ok());
  while (Turn(worker) && turns < 10 * kTiles) ++turns;
  EXPECT_TRUE(blobs_->Verify(mesh).ok());
  EXPECT_EQ(Job(again).header.state, JobState::kSucceeded);
  EXPECT_LE(turns, kTiles + 2 + 2) << "each task once, and an attempt that found its inputs lost for each phase";
}

// The collector is about to remove an old blob. A worker stores it again and reports it.
TEST_F(StoreCallsTest, ReportGoesOnWhileBlobsAreRemovedAndItsBlobStays) {
  const std::string job = Create(Scene(1)), worker = Worker();
  const auto lease = LeaseFrom(worker);
  ASSERT_TRUE(lease);
  const ReportedResult result = Result(*lease);
  std::vector<BlobEntry> doomed;
  Reclaimer reclaimer(coordinator_->core());
  reclaimer.CollectReferences();
  for (const NamedDigest& output : result.outputs) {
    const timespec long_ago[] = {{1000, 0}, {1000, 0}};
    ASSERT_EQ(::utimensat(AT_FDCWD, blobs_->LocalPath(output.digest)->c_str(), long_ago, 0), 0);
  }
  for (int part = 0; part < BlobStore::kParts; ++part) {
    const auto entries = blobs_->List(part);
    ASSERT_TRUE(entries.ok()) << entries.status();
    doomed.insert(doomed.end(), entries->begin(), entries->end());
  }
  ASSERT_EQ(doomed.size(), 2u);
  watched_.Hold();
  auto removed = std::async(std::launch::async, [&] { return reclaimer.RemoveBlobs(doomed); });
  ASSERT_TRUE(watched_.AwaitHeld(1));
  EXPECT_TRUE(Report(worker, *lease).ok());  // stores the blobs again first
  watched_.Release();
  const auto gone = removed.get();
  ASSERT_TRUE(gone.ok()) << gone.status();
  EXPECT_THAT(*gone, IsEmpty());
  for (const NamedDigest& output : result.outputs) EXPECT_TRUE(blobs_->Has(output.digest));
  EXPECT_EQ(Task(job, 0).task.state, TaskState::kSucceeded);
}

}  // namespace
}  // namespace tessera
