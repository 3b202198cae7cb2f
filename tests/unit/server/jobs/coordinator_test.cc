#include "server/jobs/coordinator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <nlohmann/json.hpp>
#include <thread>

#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

TEST_F(CoordinatorTest, RunsAJobToItsEnd) {
  const std::string job = Create(AJob(2));
  EXPECT_EQ(Job(job).header.state, JobState::kQueued);
  const std::string worker = Worker();
  const auto ingest = Lease(worker);
  ASSERT_TRUE(ingest);
  EXPECT_EQ(ingest->plan.kind, "ingest");
  EXPECT_EQ(ingest->attempt, 1);
  ASSERT_EQ(ingest->inputs.size(), 1u);
  EXPECT_EQ(ingest->inputs[0].path, "/scene/scene.json");
  EXPECT_EQ(Job(job).header.state, JobState::kRunning);
  EXPECT_FALSE(Lease(worker));  // no other task is planned yet
  clock_.Advance(2);
  ASSERT_TRUE(Succeed(worker, *ingest).ok());
  EXPECT_EQ(Job(job).tasks_total, 4);
  EXPECT_EQ(Job(job).tiles_total, 2);

  // Highest cost first.
  const auto tile1 = Lease(worker);
  ASSERT_TRUE(tile1);
  EXPECT_EQ(tile1->plan.name, "refine tile 1");
  EXPECT_EQ(tile1->inputs[0].path, *blobs_->LocalPath(tile1->inputs[0].file.digest));
  clock_.Advance(10);
  EXPECT_TRUE(Succeed(worker, *tile1).ok());
  EXPECT_EQ(Job(job).tiles_done, 1);
  EXPECT_NEAR(Job(job).progress, 0.02 + 0.98 * 2 / 4, 1e-12);
  EXPECT_NEAR(Job(job).eta_s, 2 * 10 / 2, 1e-9);  // 2 of cost left, 5 s each
  EXPECT_EQ(WorkAll(worker), 2);

  const JobStatus done = Job(job);
  EXPECT_EQ(done.header.state, JobState::kSucceeded);
  EXPECT_EQ(done.progress, 1);
  ASSERT_EQ(done.artifacts.size(), 2u);
  EXPECT_EQ(done.artifacts[0].name, "mesh.ply");
  EXPECT_EQ(done.artifacts[1].name, "job.json");
  const auto report = nlohmann::json::parse(*blobs_->Read(done.artifacts[1].digest));
  EXPECT_EQ(report["totals"]["tasks"], 4);
  EXPECT_EQ(report["totals"]["core_seconds_of_kind"]["refine"], 2 * 7.5);
  EXPECT_EQ(report["totals"]["seconds_of_stage"]["data"], 4 * 0.75);
  EXPECT_EQ(report["totals"]["seconds_of_stage"]["loading"], 4 * 0.25);
  EXPECT_EQ(report["totals"]["seconds_of_stage"]["dispatch"], (2 - 1) + (10 - 1)) << "the other tasks took no time";
  EXPECT_EQ(report["tasks"][2]["title"], "refine tile 1");
  EXPECT_EQ(report["tasks"][2]["attempts"], 1);
  EXPECT_EQ(report["tasks"][2]["seconds"], 10.0);
  EXPECT_EQ(report["tasks"][2]["stats"]["energy"], 1);
  EXPECT_EQ(report["tasks"][2]["used"]["core_seconds"], 7.5);
  EXPECT_EQ(report["tasks"][2]["used"]["peak_bytes"], 3 << 20);
  EXPECT_EQ(report["tasks"][2]["predicted"]["core_seconds"], 2.0);
}

TEST_F(CoordinatorTest, ExpiredTaskIsLeasedAgainAndTheLateReportIsRefused) {
  const std::string job = Create(AJob(1));
  const std::string first = Worker(), second = Worker();
  const auto lost = Lease(first);
  ASSERT_TRUE(lost);
  clock_.Advance(29);
  ASSERT_TRUE(coordinator_->Tick().ok());
  EXPECT_FALSE(Lease(second));
  clock_.Advance(2);
  const auto again = Lease(second);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->task, lost->task);
  EXPECT_EQ(again->attempt, 2);
  EXPECT_EQ(Succeed(first, *lost).code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(Fail(first, *lost, ErrorClass::kInput).code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(*coordinator_->leases().Heartbeat(first, {{lost->task, 1, 0.5, ""}}), ElementsAre(lost->task));
  EXPECT_EQ(Task(job, 0).task.state, TaskState::kLeased);
  EXPECT_TRUE(Succeed(second, *again).ok());
  EXPECT_TRUE(Succeed(second, *again).ok());  // repeated report
  EXPECT_EQ(Succeed(first, *again).code(), absl::StatusCode::kFailedPrecondition);
}

TEST_F(CoordinatorTest, HeartbeatsKeepALease) {
  const std::string job = Create(AJob(1));
  const std::string worker = Worker();
  const auto lease = Lease(worker);
  ASSERT_TRUE(lease);
  for (int i = 0; i < 5; ++i) {
    clock_.Advance(20);
    EXPECT_THAT(*coordinator_->leases().Heartbeat(worker, {{lease->task, 1, 0.1 * i, "reading"}}), IsEmpty());
    ASSERT_TRUE(coordinator_->Tick().ok());
  }
  EXPECT_NEAR(Task(job, 0).progress, 0.4, 1e-12);
  EXPECT_EQ(Task(job, 0).stage, "reading");
  EXPECT_EQ(coordinator_->leases().ListWorkers().at(0).tasks, std::vector<std::string>{lease->task});
  EXPECT_TRUE(Succeed(worker, *lease).ok());
}

TEST_F(CoordinatorTest, TransientErrorsDelayAndThenFailTheTask) {
  const std::string job = Create(AJob(1));
  const std::string worker = Worker();
  const double delays_s[] = {1, 2, 4};
  for (const double delay_s : delays_s) {
    const auto lease = Lease(worker);
    ASSERT_TRUE(lease);
    ASSERT_TRUE(Fail(worker, *lease, ErrorClass::kTransient).ok());
    clock_.Advance(delay_s - 0.1);
    EXPECT_FALSE(Lease(worker));
    clock_.Advance(0.2);
  }
  const auto last = Lease(worker);
  ASSERT_TRUE(last);
  EXPECT_EQ(last->attempt, 4);
  ASSERT_TRUE(Fail(worker, *last, ErrorClass::kTransient).ok());
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_THAT(Job(job).header.error, HasSubstr("read the scene: it broke (transient, attempt 4)"));
  EXPECT_EQ(Job(job).artifacts.at(0).name, "job.json");
}

TEST_F(CoordinatorTest, ConfirmedInputErrorFailsTheJob) {
  const std::string job = Create(AJob(2));
  const std::string worker = Worker();
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  const auto a = Lease(worker), b = Lease(worker);
  ASSERT_TRUE(a && b);
  ASSERT_TRUE(Fail(worker, *a, ErrorClass::kInput).ok());
  EXPECT_EQ(Job(job).header.state, JobState::kRunning);
  clock_.Advance(1.1);
  ASSERT_TRUE(Fail(worker, *Lease(worker), ErrorClass::kInput).ok());
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_EQ(Job(job).header.error, "refine tile 1: it broke");
  EXPECT_EQ(Task(job, 2).task.state, TaskState::kFailed);
  EXPECT_EQ(Task(job, 1).task.state, TaskState::kCancelled);
  EXPECT_THAT(*coordinator_->leases().Heartbeat(worker, {{b->task, 1, 0, ""}}), ElementsAre(b->task));
  EXPECT_EQ(Succeed(worker, *b).code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_FALSE(Lease(worker));
}

TEST_F(CoordinatorTest, MemoryErrorGoesToAnotherWorkerThenFails) {
  const std::string job = Create(AJob(1));
  const std::string small = Worker(), large = Worker();
  ASSERT_TRUE(Fail(small, *Lease(small), ErrorClass::kMemory).ok());
  EXPECT_FALSE(Lease(small));
  const auto lease = Lease(large);
  ASSERT_TRUE(lease);
  ASSERT_TRUE(Fail(large, *lease, ErrorClass::kMemory).ok());
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
}

TEST_F(CoordinatorTest, UnregisteringReturnsTheTask) {
  Create(AJob(1));
  const std::string first = Worker(), second = Worker();
  ASSERT_TRUE(Lease(first));
  ASSERT_TRUE(UnregisterAndWait(*coordinator_, first).ok());
  const auto lease = Lease(second);
  ASSERT_TRUE(lease);
  EXPECT_EQ(lease->attempt, 2);
  EXPECT_EQ(LeaseAndWait(*coordinator_, first, 0, {}).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(coordinator_->leases().Heartbeat(first, {}).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(CoordinatorTest, AbortedAttemptIsLeasedAgainAtOnce) {
  Create(AJob(1));
  const std::string worker = Worker();
  ASSERT_TRUE(Fail(worker, *Lease(worker), ErrorClass::kPreempted).ok());
  const auto lease = Lease(worker);
  ASSERT_TRUE(lease);
  EXPECT_EQ(lease->attempt, 2);
}

// A worker with the tile in memory gets its tasks; other workers only after a wait.
TEST_F(CoordinatorTest, TileStaysWithItsWorkerUnlessThatOneIsSlow) {
  Create(AJob(1));
  const std::string keeper = Worker(), other = Worker();
  ASSERT_TRUE(Succeed(keeper, *Lease(keeper)).ok());
  ASSERT_TRUE(Fail(keeper, *Lease(keeper), ErrorClass::kPreempted).ok());
  std::atomic<bool> gone = false;
  std::thread waiting([&] { EXPECT_FALSE(*LeaseAndWait(*coordinator_, other, 60, [&] { return gone.load(); })); });
  std::this_thread::sleep_for(std::chrono::milliseconds(100));  // less than the wait
  const auto lease = Lease(keeper);
  gone = true;
  waiting.join();
  ASSERT_TRUE(lease);
  EXPECT_EQ(lease->plan.kind, "refine");
  ASSERT_TRUE(Fail(keeper, *lease, ErrorClass::kPreempted).ok());
  // A call with a report does not wait, but leaves the tile to its worker.
  std::promise<bool> brought;
  LeaseCall with_report = {.worker = other,
                           .done = [&](LeaseAnswer answer) { brought.set_value(answer->has_value()); }};
  with_report.comes_with_report = true;
  coordinator_->leases().LeaseTask(std::move(with_report));
  EXPECT_FALSE(brought.get_future().get());
  // It waits at most as long as for any task.
  const auto taken = LeaseAndWait(*coordinator_, other, 0.2, {});
  ASSERT_TRUE(taken.ok() && *taken);
  EXPECT_EQ((*taken)->plan.kind, "refine");
  // No wait for the tile of an unregistered worker.
  ASSERT_TRUE(Fail(other, **taken, ErrorClass::kPreempted).ok());
  ASSERT_TRUE(UnregisterAndWait(*coordinator_, other).ok());
  EXPECT_TRUE(*LeaseAndWait(*coordinator_, keeper, 3600, {}));
}

TEST_F(CoordinatorTest, SilentWorkersAreForgotten) {
  const std::string worker = Worker();
  clock_.Advance(100);
  ASSERT_TRUE(coordinator_->Tick().ok());
  EXPECT_TRUE(coordinator_->leases().ListWorkers().empty());
  EXPECT_EQ(coordinator_->leases().Heartbeat(worker, {}).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(CoordinatorTest, KnownResultsAreReused) {
  const std::string worker = Worker();
  const std::string first = Create(AJob(2));
  EXPECT_EQ(WorkAll(worker), 4);
  const std::string second = Create(AJob(2));
  EXPECT_EQ(Job(second).header.state, JobState::kSucceeded);
  EXPECT_EQ(Job(second).artifacts[0], Job(first).artifacts[0]);
  EXPECT_TRUE(Task(second, 1).task.reused);
  EXPECT_EQ(Task(second, 1).task.attempt(), 0);
  // Another number of tiles reuses ingest and the first two tiles.
  const std::string third = Create(AJob(3));
  EXPECT_EQ(WorkAll(worker), 2);
  EXPECT_EQ(Job(third).header.state, JobState::kSucceeded);
  // Another content reuses nothing.
  Create(AJob(2, "{\"other\":1}"));
  EXPECT_EQ(WorkAll(worker), 4);
}

TEST_F(CoordinatorTest, LostBlobsAreRecomputed) {
  const std::string worker = Worker();
  const std::string first = Create(AJob(1));
  WorkAll(worker);
  ASSERT_TRUE(RemoveTree(*blobs_->LocalPath(Task(first, 1).task.outputs[0].digest())).ok());
  const std::string second = Create(AJob(1));
  EXPECT_EQ(WorkAll(worker), 1);
  EXPECT_EQ(Job(second).header.state, JobState::kSucceeded);
  EXPECT_FALSE(Task(second, 1).task.reused);
}

TEST_F(CoordinatorTest, MissingOutputsFailTheAttempt) {
  const std::string job = Create(AJob(1));
  const std::string worker = Worker();
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  for (int attempt = 1; attempt <= 4; ++attempt) {
    const auto refine = Lease(worker);
    ASSERT_TRUE(refine);
    ASSERT_TRUE(ReportSuccessAndWait(*coordinator_, worker, refine->task, attempt, {}).ok());
    clock_.Advance(10);
  }
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_THAT(Job(job).header.error, HasSubstr("no output refined, which 'publish' reads"));
}

TEST_F(CoordinatorTest, PlanErrorsFailTheJob) {
  const std::string job = Create(AJob(1));
  const std::string worker = Worker();
  const auto ingest = Lease(worker);
  ASSERT_TRUE(ReportSuccessAndWait(*coordinator_, worker, ingest->task, 1, Result(*ingest, "bad")).ok());
  EXPECT_EQ(Job(job).header.error, "cannot plan the job: bad survey");
  EXPECT_TRUE(Job(job).header.bad_input);
  NewJob unknown = AJob(1);
  unknown.settings.method = "magic";
  EXPECT_EQ(coordinator_->jobs().CreateJob(unknown).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(CoordinatorTest, ThreadsFollowTheNumberOfTasks) {
  const auto worker = [&](const char* host, int threads) {
    return *coordinator_->leases().RegisterWorker({host, 1, threads, 1000, 8});
  };
  const std::string a = worker("one", 8), b = worker("one", 8), narrow = worker("other", 3);
  Create(AJob(4));
  const auto ingest = Lease(a);
  EXPECT_EQ(ingest->threads, 8) << "no other task is planned yet";
  ASSERT_TRUE(Succeed(a, *ingest).ok());
  const auto first = Lease(a), second = Lease(narrow), third = Lease(b);
  EXPECT_EQ(first->threads, 4) << "three more tasks for two workers";
  EXPECT_EQ(second->threads, 3) << "its limit, on its own host";
  EXPECT_EQ(third->threads, 4);
  ASSERT_TRUE(Succeed(narrow, *second).ok());
  ASSERT_TRUE(Succeed(a, *first).ok());
  const auto fourth = Lease(a);
  EXPECT_EQ(fourth->threads, 4) << "b still runs";
  ASSERT_TRUE(Succeed(a, *fourth).ok());
  ASSERT_TRUE(Succeed(b, *third).ok());
  EXPECT_EQ(Lease(b)->threads, 8) << "publish is the only task";
}

TEST_F(CoordinatorTest, AllocationsOfOneHostShareNoCores) {
  const auto worker = [&](const char* machine) {
    return *coordinator_->leases().RegisterWorker({"host", 1, 8, 1000, 8, machine});
  };
  const std::string a = worker("host/boot/41"), b = worker("host/boot/42"), c = worker("host/boot/42");
  Create(AJob(6));
  ASSERT_TRUE(Succeed(a, *Lease(a)).ok());
  EXPECT_EQ(Lease(a)->threads, 8);
  EXPECT_EQ(Lease(b)->threads, 4);
  EXPECT_EQ(Lease(c)->threads, 4);
}

TEST_F(CoordinatorTest, CancelStopsAndIsFinal) {
  const std::string job = Create(AJob(1));
  const std::string worker = Worker();
  const auto lease = Lease(worker);
  EXPECT_EQ(coordinator_->jobs().CancelJob(job)->header.state, JobState::kCancelled);
  EXPECT_EQ(coordinator_->jobs().CancelJob(job)->header.state, JobState::kCancelled);
  EXPECT_THAT(*coordinator_->leases().Heartbeat(worker, {{lease->task, 1, 0, ""}}), ElementsAre(lease->task));
  EXPECT_FALSE(Succeed(worker, *lease).ok());
  EXPECT_FALSE(Lease(worker));
  EXPECT_EQ(coordinator_->jobs().CancelJob("jobs/9").status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(coordinator_->jobs().GetJob("nonsense").status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(CoordinatorTest, OlderJobsFirstAndOneJobPerRequest) {
  NewJob job = AJob(1, "a");
  job.request = {"r", "/scene", job.settings};
  const std::string first = Create(job);
  EXPECT_EQ(Create(job), first);
  const std::string second = Create(AJob(1, "b"));
  EXPECT_NE(first, second);
  EXPECT_EQ((*coordinator_->jobs().FindRequest(job.request))->header.name, first);
  EXPECT_EQ(Lease(Worker())->task, first + "/tasks/0");
  const auto list = coordinator_->jobs().ListJobs(-1, 10);
  ASSERT_EQ(list.size(), 2u);
  EXPECT_EQ(list[0].header.name, second);
  EXPECT_EQ(coordinator_->jobs().ListJobs(1, 10).at(0).header.name, first);
}

TEST_F(CoordinatorTest, ReusedRequestIdReportsTheDifferences) {
  NewJob job = AJob(1);
  job.settings.rounds = 2;
  job.request = {"r", "/scene", job.settings};
  const std::string first = Create(job);
  Restart();
  EXPECT_EQ(Create(job), first);
  NewJob other = job;
  other.request.scene_path = "/other";
  other.request.settings.tiles = 3;
  other.request.settings.rounds = 0;
  other.request.settings.method_settings.semantic = 0.5;
  other.request.settings.method_settings.levels = {2, 1};
  const Status differs = coordinator_->jobs().CreateJob(other).status();
  EXPECT_EQ(differs.code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(std::string(differs.message()),
            "request r was used for jobs/1 with other values:\n"
            "tiles: found 3, expected 1\n"
            "rounds: found 0, expected 2\n"
            "method_settings.semantic: found 0.5, expected not set\n"
            "method_settings.levels: found 2, 1, expected not set\n"
            "scene_path: found /other, expected /scene");
  EXPECT_EQ(coordinator_->jobs().FindRequest(other.request).status(), differs);
  other = job;
  other.request.settings.update.base = "jobs/1";
  EXPECT_THAT(std::string(coordinator_->jobs().FindRequest(other.request).status().message()),
              HasSubstr("update.base: found \"jobs/1\", expected \"\""));
  other.request.settings.update.rollback_to = "jobs/7";
  other.request.settings.update.rollback_tiles = {4, 5};
  EXPECT_THAT(std::string(coordinator_->jobs().FindRequest(other.request).status().message()),
              testing::AllOf(HasSubstr("update.rollback_to: found \"jobs/7\", expected \"\""),
                             HasSubstr("update.rollback_tiles: found 4, 5, expected not set")));
  EXPECT_EQ(coordinator_->jobs().ListJobs(-1, 10).size(), 1u);
}

TEST_F(CoordinatorTest, WorkersContinueAfterARestart) {
  const std::string job = Create(AJob(1));
  const std::string worker = Worker();
  const auto lease = Lease(worker);
  clock_.Advance(25);
  Restart();
  // A new worker gets a new name; the old lease has a full term from now on.
  EXPECT_NE(Worker(), worker);
  clock_.Advance(25);
  EXPECT_THAT(*coordinator_->leases().Heartbeat(worker, {{lease->task, lease->attempt, 0.5, ""}}), IsEmpty());
  ASSERT_TRUE(Succeed(worker, *lease).ok());
  const std::string registered_again = Worker();
  WorkAll(registered_again);
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
  // A worker that does not call loses the task; attempt numbers continue.
  Create(AJob(1, "other"));
  ASSERT_TRUE(Lease(registered_again));
  Restart();
  clock_.Advance(31);
  const auto again = Lease(Worker());
  ASSERT_TRUE(again);
  EXPECT_EQ(again->attempt, 2);
}

TEST_F(CoordinatorTest, ProgressDoesNotDecreaseWithALostLease) {
  const std::string job = Create(AJob(1)), worker = Worker();
  const auto lease = Lease(worker);
  ASSERT_TRUE(coordinator_->leases().Heartbeat(worker, {{lease->task, 1, 0.5, ""}}).ok());
  EXPECT_NEAR(Job(job).progress, 0.5 * 0.02, 1e-12);
  ASSERT_TRUE(Fail(worker, *lease, ErrorClass::kPreempted).ok());
  EXPECT_NEAR(Job(job).progress, 0.5 * 0.02, 1e-12);
}

TEST_F(CoordinatorTest, LeaseWithALostReplyIsGrantedAgain) {
  Create(AJob(2));
  const std::string worker = Worker();
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  const auto first = *LeaseAndWait(*coordinator_, worker, 0, {}, 7);
  ASSERT_TRUE(first);
  clock_.Advance(20);
  const auto again = *LeaseAndWait(*coordinator_, worker, 0, {}, 7);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->task, first->task);
  EXPECT_EQ(again->attempt, first->attempt);
  EXPECT_EQ(again->threads, first->threads);
  EXPECT_EQ(again->inputs.size(), first->inputs.size());
  clock_.Advance(20);  // the repeated grant starts a full term
  const auto second = *LeaseAndWait(*coordinator_, worker, 0, {}, 8);
  ASSERT_TRUE(second);
  EXPECT_NE(second->task, first->task);
  EXPECT_TRUE(Succeed(worker, *again).ok());
  EXPECT_TRUE(Succeed(worker, *second).ok());
  // The lease has ended: the same number is a new call.
  EXPECT_EQ((*LeaseAndWait(*coordinator_, worker, 0, {}, 8))->plan.kind, "publish");
}

TEST_F(CoordinatorTest, WaitingWorkerWakesWhenAJobComes) {
  const std::string worker = Worker();
  std::thread creator([&] { Create(AJob(1)); });
  const auto lease = LeaseAndWait(*coordinator_, worker, 60, {});
  creator.join();
  ASSERT_TRUE(lease.ok() && *lease);
  EXPECT_EQ((*lease)->plan.kind, "ingest");
  std::thread stopper([&] { coordinator_->core().Stop(); });
  EXPECT_FALSE(*LeaseAndWait(*coordinator_, worker, 60, {}));
  stopper.join();
  EXPECT_FALSE(*LeaseAndWait(*coordinator_, worker, 60, [] { return true; }));
}

}  // namespace
}  // namespace tessera
