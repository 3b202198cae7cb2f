#include "worker/agent/agent.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <thread>

#include "common/base/parallel.h"
#include "common/job/end_margin.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "tests/unit/worker/agent/agent_fixture.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Pair;

TEST_F(AgentTest, RunsATaskThroughTheBlobService) {
  v1::Lease lease = NewLease("jobs/1/tasks/1", 3);
  AddInput(lease, "in.txt", "hello");
  AddInput(lease, "sub/other.bin", "");
  coordinator_.Queue(lease);
  StartAgent(Concatenate);
  const v1::ReportTaskRequest report = WaitForReport();
  ASSERT_TRUE(report.has_success()) << report.failure().message();
  EXPECT_EQ(report.task(), "jobs/1/tasks/1");
  EXPECT_EQ(report.attempt(), 3);
  EXPECT_EQ(report.worker(), "workers/1");
  EXPECT_EQ(report.success().stats_json(), "{\"n\":1}");
  EXPECT_GT(report.success().usage().core_seconds(), 0);
  EXPECT_GE(report.success().usage().threads(), 1);
  EXPECT_THAT(report.success().warnings(), ElementsAre("odd \\xff byte"));
  ASSERT_EQ(report.success().outputs_size(), 1);
  EXPECT_EQ(report.success().outputs(0).name(), "out.txt");
  EXPECT_EQ(coordinator_.blobs().Content(DigestOf(report.success().outputs(0))), "cut({})in.txt=hello;sub/other.bin=;");
  EXPECT_THAT(coordinator_.unregistered, ElementsAre("workers/1"));
  EXPECT_TRUE(agent_status_.ok());
}

// One call reports and leases the next task. If the answer contains no lease, the lease call uses the same number.
TEST_F(AgentTest, AnswerToAReportContainsTheNextLease) {
  coordinator_.BringTasksWithAnswers();
  for (const char* task : {"jobs/1/tasks/1", "jobs/1/tasks/2", "jobs/1/tasks/3"}) coordinator_.Queue(NewLease(task));
  StartAgent(Concatenate);
  EXPECT_TRUE(coordinator_.WaitFor(
      [](const FakeWorkersService& c) { return c.reports.size() == 3 && c.lease_calls.size() == 2; }));
  StopAgent();
  std::vector<std::pair<std::string, int64_t>> reports;
  for (const v1::ReportTaskRequest& report : coordinator_.reports) {
    EXPECT_TRUE(report.has_success());
    reports.emplace_back(report.task(), report.lease_call());
  }
  EXPECT_THAT(reports, ElementsAre(Pair("jobs/1/tasks/1", 2), Pair("jobs/1/tasks/2", 3), Pair("jobs/1/tasks/3", 4)));
  EXPECT_THAT(coordinator_.lease_calls, ElementsAre(1, 4));
}

TEST_F(AgentTest, TaskUsesTheThreadsOfItsLease) {
  v1::Lease lease = NewLease("jobs/1/tasks/1");
  lease.set_threads(1);
  coordinator_.Queue(lease);
  std::atomic<int> threads = 0;
  StartAgent([&threads](const TaskRequest& request, const TaskControl& control) {
    threads = ThreadCount();
    return Concatenate(request, control);
  });
  const v1::ReportTaskRequest report = WaitForReport();
  ASSERT_TRUE(report.has_success()) << report.failure().message();
  EXPECT_EQ(threads, 1);
  EXPECT_EQ(report.success().usage().threads(), 1);
}

// Consecutive tasks only see their own inputs, even if the first one left files.
TEST_F(AgentTest, TasksSeeOnlyTheirOwnFiles) {
  v1::Lease first = NewLease("jobs/1/tasks/1"), second = NewLease("jobs/1/tasks/2"), third = NewLease("jobs/1/tasks/3");
  AddInput(first, "0001/state", "one");
  AddInput(first, "0002/state", "two");
  AddInput(second, "0002/state", "three");
  AddInput(second, "in.txt", "four");
  AddInput(third, "0001/state", "five");
  for (const v1::Lease& lease : {first, second, third}) coordinator_.Queue(lease);
  StartAgent([](const TaskRequest& request, const TaskControl& control) {
    EXPECT_TRUE(fs::is_empty(request.output_dir));
    std::ofstream(request.output_dir + "/scratch") << "left behind";
    return Concatenate(request, control);
  });
  WaitForReport(3);
  std::vector<std::string> contents;
  for (const v1::ReportTaskRequest& report : coordinator_.reports) {
    ASSERT_TRUE(report.has_success()) << report.failure().message();
    contents.push_back(coordinator_.blobs().Content(DigestOf(report.success().outputs(0))));
  }
  EXPECT_THAT(contents, ElementsAre("cut({})0001/state=one;0002/state=two;", "cut({})0002/state=three;in.txt=four;",
                                    "cut({})0001/state=five;"));
}

// A task that reads inspections fetches the images that it needs. An empty folder of the scene does not stay.
TEST_F(AgentTest, InspectedImagesAreFetchedOnDemand) {
  v1::Lease first = NewLease("jobs/1/tasks/1"), second = NewLease("jobs/1/tasks/2");
  AddInput(first, "0000/inspection.json", "{}");
  AddInput(first, "scene/scene.json", "{}");
  AddInput(first, "scene/images/a.jpg", "a");
  AddInput(first, "scene/images/b.jpg", "b");
  AddInput(second, "scene/images/b.jpg", "b");
  for (const v1::Lease& lease : {first, second}) coordinator_.Queue(lease);
  StartAgent([](const TaskRequest& request, const TaskControl& control) -> StatusOr<TaskOutcome> {
    const std::string images = request.input_dir + "/scene/images";
    if (fs::exists(request.input_dir + "/0000")) {
      EXPECT_TRUE(fs::exists(request.input_dir + "/scene/scene.json"));
      EXPECT_FALSE(fs::exists(images));
      for (int again = 0; again < 2; ++again) TESSERA_RETURN_IF_ERROR(request.fetch({images + "/b.jpg"}));
      EXPECT_FALSE(fs::exists(images + "/a.jpg"));
    } else {
      EXPECT_FALSE(fs::exists(images + "/../scene.json"));
    }
    EXPECT_EQ(ReadFile(images + "/b.jpg").value(), "b") << "a task without inspections has all its inputs";
    return Concatenate({request.kind, request.parameters, images, request.output_dir}, control);
  });
  WaitForReport(2);
  for (const v1::ReportTaskRequest& report : coordinator_.reports) {
    EXPECT_TRUE(report.has_success()) << report.failure().message();
  }
  EXPECT_EQ(coordinator_.blobs().read_offsets().size(), 2u) << "{} and b, which stay in the cache";
}

// So does a crop that reads earlier crops, of which it needs few images or none.
TEST_F(AgentTest, ViewsOfEarlierCropsAreFetchedOnDemand) {
  v1::Lease lease = NewLease("jobs/1/tasks/1");
  AddInput(lease, "0002/tile.arrays", "tile");
  AddInput(lease, "0002/views.arrays", "crops");
  AddInput(lease, "views/000003.image", "a");
  AddInput(lease, "views/000003.likelihoods", "b");
  coordinator_.Queue(lease);
  StartAgent([](const TaskRequest& request, const TaskControl& control) {
    EXPECT_TRUE(fs::exists(request.input_dir + "/0002/tile.arrays"));
    EXPECT_TRUE(fs::exists(request.input_dir + "/0002/views.arrays"));
    EXPECT_FALSE(fs::exists(request.input_dir + "/views"));
    EXPECT_TRUE(request.fetch({request.input_dir + "/views/000003.image"}).ok());
    EXPECT_EQ(ReadFile(request.input_dir + "/views/000003.image").value(), "a");
    EXPECT_FALSE(fs::exists(request.input_dir + "/views/000003.likelihoods"));
    return Concatenate(request, control);
  });
  EXPECT_TRUE(WaitForReport().has_success());
}

// The error of a fetch on demand is that of the input.
TEST_F(AgentTest, ImageThatIsLostOnDemandFailsTheAttempt) {
  v1::Lease lease = NewLease("jobs/1/tasks/1");
  AddInput(lease, "0000/inspection.json", "{}");
  AddInput(lease, "scene/images/a.jpg", Digest{Sha256Hex("lost"), 4}, "");
  coordinator_.Queue(lease);
  StartAgent([](const TaskRequest& request, const TaskControl&) -> StatusOr<TaskOutcome> {
    return request.fetch({request.input_dir + "/scene/images/a.jpg"});
  });
  const v1::ReportTaskRequest report = WaitForReport();
  ASSERT_TRUE(report.has_failure());
  EXPECT_EQ(report.failure().error_class(), v1::ERROR_CLASS_LOST_INPUT);
}

TEST_F(AgentTest, SharedFilesAreLinkedAndOutputsGoToTheSharedFolder) {
  const std::string shared = folder_.path() + "/blobs";
  ASSERT_TRUE(FolderBlobs::Open(shared).ok());
  ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/probe", "secret").ok());
  ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/scene.txt", "hello").ok());
  coordinator_.ShareFolder(shared, folder_.path() + "/probe", "secret");
  v1::Lease lease = NewLease("jobs/1/tasks/1");
  AddInput(lease, "in.txt", Digest{Sha256Hex("hello"), 5}, folder_.path() + "/scene.txt");
  coordinator_.Queue(lease);
  StartAgent([](const TaskRequest& request, const TaskControl& control) {
    EXPECT_TRUE(fs::is_symlink(request.input_dir + "/in.txt"));
    return Concatenate(request, control);
  });
  const v1::ReportTaskRequest report = WaitForReport();
  ASSERT_TRUE(report.has_success()) << report.failure().message();
  EXPECT_EQ(FolderBlobs::Open(shared).value()->Read(DigestOf(report.success().outputs(0))).value(),
            "cut({})in.txt=hello;");
  EXPECT_THAT(coordinator_.blobs().read_offsets(), testing::IsEmpty());
  EXPECT_THAT(coordinator_.blobs().write_offsets(), testing::IsEmpty());
}

TEST_F(AgentTest, SharedFileWithWrongContentIsNotUsed) {
  ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/scene.txt", "jello").ok());
  v1::Lease lease = NewLease("jobs/1/tasks/1");
  AddInput(lease, "in.txt", "hello", folder_.path() + "/scene.txt");
  coordinator_.Queue(lease);
  StartAgent(Concatenate);
  const v1::ReportTaskRequest report = WaitForReport();
  ASSERT_TRUE(report.has_success()) << report.failure().message();
  EXPECT_EQ(coordinator_.blobs().Content(DigestOf(report.success().outputs(0))), "cut({})in.txt=hello;");
}

TEST_F(AgentTest, SharedPathsAreNotAccessedWithoutSharedStorage) {
  const std::string shared = folder_.path() + "/blobs";
  ASSERT_TRUE(FolderBlobs::Open(shared).ok());
  ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/probe", "secret").ok());
  ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/scene.txt", "hello").ok());
  coordinator_.ShareFolder(shared, folder_.path() + "/probe", "secret");
  v1::Lease lease = NewLease("jobs/1/tasks/1");
  AddInput(lease, "in.txt", "hello", folder_.path() + "/scene.txt");
  coordinator_.Queue(lease);
  StartAgent(Concatenate, /*use_shared_storage=*/false);
  const v1::ReportTaskRequest report = WaitForReport();
  ASSERT_TRUE(report.has_success()) << report.failure().message();
  EXPECT_THAT(coordinator_.blobs().read_offsets(), ElementsAre(0));
  EXPECT_TRUE(coordinator_.blobs().Holds(DigestOf(report.success().outputs(0))));
}

TEST_F(AgentTest, WrongProbeContentSelectsTheBlobService) {
  const std::string shared = folder_.path() + "/blobs";
  ASSERT_TRUE(FolderBlobs::Open(shared).ok());
  ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/probe", "of another coordinator").ok());
  coordinator_.ShareFolder(shared, folder_.path() + "/probe", "secret");
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  StartAgent(Concatenate);
  EXPECT_TRUE(coordinator_.blobs().Holds(DigestOf(WaitForReport().success().outputs(0))));
}

TEST_F(AgentTest, InputChangedDuringTheTaskFailsTheAttempt) {
  const std::string path = folder_.path() + "/scene.txt";
  ASSERT_TRUE(WriteFileAtomic(path, "hello").ok());
  v1::Lease lease = NewLease("jobs/1/tasks/1");
  AddInput(lease, "in.txt", Digest{Sha256Hex("hello"), 5}, path);
  coordinator_.Queue(lease);
  StartAgent([&](const TaskRequest& request, const TaskControl& control) {
    EXPECT_TRUE(WriteFileAtomic(path, "other content").ok());
    return Concatenate(request, control);
  });
  const v1::ReportTaskRequest report = WaitForReport();
  EXPECT_EQ(report.failure().error_class(), v1::ERROR_CLASS_LOST_INPUT);
  ASSERT_EQ(report.failure().lost_inputs_size(), 1);
  EXPECT_EQ(report.failure().lost_inputs(0).sha256(), Sha256Hex("hello"));
  EXPECT_THAT(report.failure().message(), HasSubstr("scene.txt was changed"));
}

TEST_F(AgentTest, InputNamesOutsideTheFolderAreRejected) {
  for (const std::string name : {"../evil", "/tmp/evil", "a/../../evil", ""}) {
    v1::Lease lease = NewLease("jobs/1/tasks/1");
    AddInput(lease, name, "hello");
    coordinator_.Queue(lease);
  }
  std::atomic<int> runs{0};
  StartAgent([&](const TaskRequest& request, const TaskControl& control) {
    ++runs;
    return Concatenate(request, control);
  });
  WaitForReport(4);
  EXPECT_EQ(runs, 0);
  for (const v1::ReportTaskRequest& report : coordinator_.reports) {
    EXPECT_EQ(report.failure().error_class(), v1::ERROR_CLASS_INPUT);
  }
}

TEST_F(AgentTest, LostLeaseStopsTheTaskWithoutAReport) {
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  std::atomic<bool> stopped{false};
  StartAgent([&](const TaskRequest& request, const TaskControl& control) -> StatusOr<TaskOutcome> {
    if (request.parameters == "second") return Concatenate(request, control);
    control.Report(0.5, "half");
    coordinator_.Void("jobs/1/tasks/1");
    while (control.Check().ok()) std::this_thread::yield();
    stopped = true;
    return Concatenate(request, control);  // succeeds although the lease is lost
  });
  v1::Lease second = NewLease("jobs/1/tasks/2");
  second.mutable_spec()->set_parameters_json("second");
  coordinator_.Queue(second);
  EXPECT_EQ(WaitForReport().task(), "jobs/1/tasks/2");
  EXPECT_TRUE(stopped);
  EXPECT_EQ(coordinator_.reports.size(), 1u);
}

// A lease also ends when its report is accepted: a worker that did not receive the answer reports once more.
TEST_F(AgentTest, ReportIsRepeatedOnceIfItsAnswerWasLost) {
  coordinator_.LoseAnswersOf("jobs/1/tasks/1");
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  coordinator_.Queue(NewLease("jobs/1/tasks/2"));
  StartAgent(Concatenate);
  EXPECT_TRUE(coordinator_.WaitFor([](const FakeWorkersService& c) { return c.reports_answered == 2; }));
  StopAgent();
  EXPECT_GT(coordinator_.reports.size(), 2u);
  EXPECT_EQ(coordinator_.reports.back().task(), "jobs/1/tasks/2");
}

TEST_F(AgentTest, HeartbeatsCarryProgress) {
  coordinator_.Queue(NewLease("jobs/1/tasks/1", 7));
  StartAgent([&](const TaskRequest& request, const TaskControl& control) {
    control.Report(0.25, "level 1");
    EXPECT_TRUE(coordinator_.WaitFor([](const FakeWorkersService& c) {
      return !c.progress.empty() && c.progress.back().stage() == "level 1" && c.progress.back().progress() == 0.25 &&
             c.progress.back().attempt() == 7;
    }));
    return Concatenate(request, control);
  });
  EXPECT_TRUE(WaitForReport().has_success());
}

TEST_F(AgentTest, WorkerRegistersAgainAndReportsItsTask) {
  coordinator_.Queue(NewLease("jobs/1/tasks/1", 2));
  StartAgent([&](const TaskRequest& request, const TaskControl& control) {
    coordinator_.Stop();
    coordinator_.Start(/*forget=*/true);
    EXPECT_TRUE(control.Check().ok());
    return Concatenate(request, control);
  });
  const v1::ReportTaskRequest report = WaitForReport();
  EXPECT_TRUE(report.has_success());
  EXPECT_EQ(report.attempt(), 2);
  EXPECT_EQ(report.worker(), "workers/2");
}

TEST_F(AgentTest, ResultIsReportedOnceTheCoordinatorIsReachable) {
  v1::Lease lease = NewLease("jobs/1/tasks/1");
  coordinator_.Queue(lease);
  std::atomic<bool> away{false};
  StartAgent([&](const TaskRequest& request, const TaskControl& control) {
    coordinator_.Stop();
    away = true;
    return Concatenate(request, control);
  });
  while (!away) std::this_thread::yield();
  coordinator_.Start();
  EXPECT_TRUE(WaitForReport().has_success());
}

TEST_F(AgentTest, RejectedReportOfAnOldAttemptIsDropped) {
  coordinator_.AnswerReportsWith(Refused(grpc::StatusCode::FAILED_PRECONDITION, v1::Refusal::REASON_NOT_CURRENT));
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  coordinator_.Queue(NewLease("jobs/1/tasks/2"));
  StartAgent(Concatenate);
  WaitForReport(2);
  ASSERT_EQ(coordinator_.reports.size(), 2u);
  EXPECT_EQ(coordinator_.reports[0].task(), "jobs/1/tasks/1");
  EXPECT_EQ(coordinator_.reports[1].task(), "jobs/1/tasks/2");
}

// Codes such as NOT_FOUND have many causes; the status details decide what to do.
TEST_F(AgentTest, RegistersAgainOnlyForUnknownWorkerDetails) {
  for (const auto code : {grpc::StatusCode::FAILED_PRECONDITION, grpc::StatusCode::NOT_FOUND}) {
    coordinator_.AnswerLeasesWith(grpc::Status(code, "something else"), 2);
    coordinator_.Queue(NewLease("jobs/1/tasks/" + std::to_string(code)));
  }
  StartAgent(Concatenate);
  WaitForReport(2);
  EXPECT_EQ(coordinator_.reports.size(), 2u);
  EXPECT_EQ(coordinator_.registrations, 1);
}

TEST_F(AgentTest, DrainReportsTheTaskAsPreempted) {
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  StartAgent([&](const TaskRequest&, const TaskControl& control) -> StatusOr<TaskOutcome> {
    std::thread([this] { agent_->Drain(); }).detach();
    while (control.Check().ok()) std::this_thread::yield();
    return control.Check();
  });
  const v1::ReportTaskRequest report = WaitForReport();
  EXPECT_EQ(report.failure().error_class(), v1::ERROR_CLASS_PREEMPTED);
  EXPECT_THAT(coordinator_.unregistered, ElementsAre("workers/1"));
}

TEST_F(AgentTest, StopLeasingEndsAfterTheCurrentTask) {
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  coordinator_.Queue(NewLease("jobs/1/tasks/2"));
  StartAgent([&](const TaskRequest& request, const TaskControl& control) {
    agent_->StopLeasing();
    EXPECT_TRUE(control.Check().ok()) << "the task continues";
    return Concatenate(request, control);
  });
  thread_.join();
  EXPECT_TRUE(agent_status_.ok());
  ASSERT_EQ(coordinator_.reports.size(), 1u);
  EXPECT_TRUE(coordinator_.reports[0].has_success());
  EXPECT_THAT(coordinator_.unregistered, ElementsAre("workers/1"));
}

TEST_F(AgentTest, StopLeasingEndsAnIdleWorkerAtOnce) {
  StartAgent(Concatenate);
  ASSERT_TRUE(coordinator_.WaitFor([](const FakeWorkersService& c) { return c.leases_asked > 0; }));
  agent_->StopLeasing();
  thread_.join();
  EXPECT_TRUE(agent_status_.ok());
  EXPECT_THAT(coordinator_.unregistered, ElementsAre("workers/1"));
}

TEST_F(AgentTest, WorkerEndsBeforeItsAllocation) {
  time_left_s_ = kEndMargin_s + 0.4;
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  StartAgent(Concatenate);
  thread_.join();
  EXPECT_TRUE(agent_status_.ok()) << agent_status_;
  EXPECT_EQ(coordinator_.reports.size(), 1u);
  EXPECT_NEAR(coordinator_.time_left_s, time_left_s_, 1);
  EXPECT_THAT(coordinator_.unregistered, ElementsAre("workers/1"));
}

TEST_F(AgentTest, WorkerWithoutTasksEnds) {
  idle_s_ = 0.4;
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  // Longer than the limit: a worker with a task is not idle.
  StartAgent([](const TaskRequest& request, const TaskControl& control) {
    std::this_thread::sleep_for(std::chrono::milliseconds(600));
    return Concatenate(request, control);
  });
  thread_.join();
  EXPECT_TRUE(agent_status_.ok()) << agent_status_;
  ASSERT_EQ(coordinator_.reports.size(), 1u);
  EXPECT_TRUE(coordinator_.reports[0].has_success());
  EXPECT_THAT(coordinator_.unregistered, ElementsAre("workers/1"));
  agent_ = nullptr;

  coordinator_.Stop();
  StartAgent(Concatenate);
  thread_.join();
  EXPECT_EQ(agent_status_.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(agent_status_.message()), HasSubstr("no coordinator at " + coordinator_.address()));
}

TEST_F(AgentTest, DrainEndsAnIdleOrUnregisteredWorkerAtOnce) {
  StartAgent(Concatenate);
  ASSERT_TRUE(coordinator_.WaitFor([](const FakeWorkersService& c) { return c.leases_asked > 0; }));
  StopAgent();
  EXPECT_TRUE(agent_status_.ok());
  coordinator_.Stop();
  StartAgent(Concatenate);
  StopAgent();
  EXPECT_TRUE(agent_status_.ok());
  coordinator_.Start();
}

TEST_F(AgentTest, RejectedVersionEndsTheWorker) {
  coordinator_.AnswerRegistrationsWith(
      Refused(grpc::StatusCode::FAILED_PRECONDITION, v1::Refusal::REASON_OTHER_VERSION));
  StartAgent(Concatenate);
  thread_.join();
  EXPECT_EQ(agent_status_.code(), absl::StatusCode::kFailedPrecondition);
}

TEST_F(AgentTest, WorkFolderIsLockedByOneProcess) {
  StartAgent(Concatenate);
  AgentOptions options;
  options.coordinator = coordinator_.address();
  options.work_dir = folder_.path() + "/work";
  EXPECT_EQ(Agent::Create(options, Concatenate).status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST_F(AgentTest, InterruptedDownloadIsResumed) {
  v1::Lease lease = NewLease("jobs/1/tasks/1");
  AddInput(lease, "in.txt", std::string(5 << 20, 'x'));
  coordinator_.blobs().BreakStreams(2, 2);
  coordinator_.Queue(lease);
  StartAgent(Concatenate);
  EXPECT_TRUE(WaitForReport().has_success());
  EXPECT_THAT(coordinator_.blobs().read_offsets(), ElementsAre(0, 2 << 20, 4 << 20));
}

}  // namespace
}  // namespace tessera
