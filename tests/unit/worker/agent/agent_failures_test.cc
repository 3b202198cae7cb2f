// Which errors fail an attempt, and with which failure class.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <atomic>
#include <cerrno>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <new>
#include <stdexcept>

#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "tests/unit/worker/agent/agent_fixture.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

using AgentFailuresTest = AgentTest;

TEST_F(AgentFailuresTest, EachFailureHasItsClassAndTheWorkerContinues) {
  const std::vector<std::pair<std::function<StatusOr<TaskOutcome>()>, v1::ErrorClass>> cases = {
      {[] { return absl::InvalidArgumentError("line 3 is wrong"); }, v1::ERROR_CLASS_INPUT},
      {[] { return absl::NotFoundError("no image"); }, v1::ERROR_CLASS_INPUT},
      {[] { return absl::ResourceExhaustedError("too big"); }, v1::ERROR_CLASS_MEMORY},
      {[]() -> StatusOr<TaskOutcome> { throw std::bad_alloc(); }, v1::ERROR_CLASS_MEMORY},
      {[]() -> StatusOr<TaskOutcome> { throw std::runtime_error("odd"); }, v1::ERROR_CLASS_INTERNAL},
      {[]() -> StatusOr<TaskOutcome> { throw 5; }, v1::ERROR_CLASS_INTERNAL},
      {[] { return absl::UnavailableError("some library's own"); }, v1::ERROR_CLASS_INTERNAL},
      {[] { return FileError(ENOSPC, "cannot write it"); }, v1::ERROR_CLASS_SCRATCH},
      {[] { return FileError(EIO, "cannot map it"); }, v1::ERROR_CLASS_SCRATCH},
      {[] { return FileError(ENOENT, "image 7"); }, v1::ERROR_CLASS_INPUT},
      {[]() -> StatusOr<TaskOutcome> {
         TaskOutcome outcome;
         outcome.outputs = {"never written"};
         return outcome;
       },
       v1::ERROR_CLASS_INTERNAL},
  };
  for (size_t i = 0; i < cases.size(); ++i) coordinator_.Queue(NewLease("jobs/1/tasks/" + std::to_string(i)));
  std::atomic<size_t> next{0};
  StartAgent([&](const TaskRequest&, const TaskControl&) { return cases[next++].first(); });
  WaitForReport(cases.size());
  ASSERT_EQ(coordinator_.reports.size(), cases.size());
  for (size_t i = 0; i < cases.size(); ++i) {
    EXPECT_EQ(coordinator_.reports[i].failure().error_class(), cases[i].second) << i;
    EXPECT_FALSE(coordinator_.reports[i].failure().message().empty()) << i;
  }
}

// All lost inputs are reported at once, whether or not they come from a shared folder.
TEST_F(AgentFailuresTest, LostInputsAreReportedByDigest) {
  const std::string shared = folder_.path() + "/blobs";
  const auto store = *FolderBlobs::Open(shared);
  ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/probe", "secret").ok());
  coordinator_.ShareFolder(shared, folder_.path() + "/probe", "secret");
  const Digest rotten = *store->PutBytes("rotten"), gone{Sha256Hex("gone"), 4}, whole = *store->PutBytes("whole");
  ASSERT_TRUE(WriteFileAtomic(*store->LocalPath(rotten), "rottem").ok());
  v1::Lease lease = NewLease("jobs/1/tasks/1");
  for (const Digest& digest : {rotten, whole, gone}) {
    AddInput(lease, "file " + digest.sha256, digest, *store->LocalPath(digest));
  }
  coordinator_.Queue(lease);
  StartAgent(Concatenate);
  const v1::ReportTaskRequest report = WaitForReport();
  EXPECT_EQ(report.failure().error_class(), v1::ERROR_CLASS_LOST_INPUT);
  ASSERT_EQ(report.failure().lost_inputs_size(), 2) << report.failure().message();
  EXPECT_EQ(report.failure().lost_inputs(0).sha256(), rotten.sha256);
  EXPECT_EQ(report.failure().lost_inputs(1).sha256(), gone.sha256);
  EXPECT_EQ(report.failure().lost_inputs(1).size_bytes(), 4);
}

// Before a failure is attributed to the input, the input is hashed again: it may have been damaged without a change
// of its time stamps.
TEST_F(AgentFailuresTest, InputsAreVerifiedBeforeAnInputErrorIsReported) {
  const std::string path = folder_.path() + "/scene.txt";
  ASSERT_TRUE(WriteFileAtomic(path, "hello").ok());
  v1::Lease lease = NewLease("jobs/1/tasks/1");
  AddInput(lease, "in.txt", Digest{Sha256Hex("hello"), 5}, path);
  coordinator_.Queue(lease);
  StartAgent([&](const TaskRequest&, const TaskControl&) -> StatusOr<TaskOutcome> {
    const auto time = fs::last_write_time(path);
    std::ofstream(path) << "jello";
    fs::last_write_time(path, time);
    return absl::InvalidArgumentError("in.txt: byte 0: found j, expected h");
  });
  EXPECT_EQ(WaitForReport().failure().error_class(), v1::ERROR_CLASS_LOST_INPUT);
}

// A file size limit has the same effect as a full disk.
TEST_F(AgentFailuresTest, FullScratchFolderIsAScratchFailure) {
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  std::signal(SIGXFSZ, SIG_IGN);
  StartAgent([](const TaskRequest& request, const TaskControl&) -> StatusOr<TaskOutcome> {
    rlimit before{}, small{};
    getrlimit(RLIMIT_FSIZE, &before);
    small = before;
    small.rlim_cur = 4096;
    setrlimit(RLIMIT_FSIZE, &small);
    const Status status = WriteFileAtomic(request.output_dir + "/large", std::string(1 << 20, 'x'));
    setrlimit(RLIMIT_FSIZE, &before);
    return status;
  });
  const v1::ReportTaskRequest report = WaitForReport();
  EXPECT_EQ(report.failure().error_class(), v1::ERROR_CLASS_SCRATCH);
  EXPECT_THAT(report.failure().message(), HasSubstr("File too large"));
}

TEST_F(AgentFailuresTest, MissingScratchFolderIsAScratchFailure) {
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  coordinator_.Queue(NewLease("jobs/1/tasks/2"));
  StartAgent([&](const TaskRequest& request, const TaskControl& control) {
    const auto outcome = Concatenate(request, control);
    fs::remove_all(folder_.path() + "/work/tasks");
    std::ofstream(folder_.path() + "/work/tasks") << "in the way";
    return outcome;
  });
  WaitForReport(2);
  EXPECT_EQ(coordinator_.reports[1].failure().error_class(), v1::ERROR_CLASS_SCRATCH)
      << coordinator_.reports[1].failure().message();
}

TEST_F(AgentFailuresTest, OutputWaitsForStorageSpace) {
  coordinator_.blobs().RefuseUploads(5);
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  std::atomic<int> runs{0};
  StartAgent([&](const TaskRequest& request, const TaskControl& control) {
    ++runs;
    return Concatenate(request, control);
  });
  EXPECT_TRUE(WaitForReport().has_success());
  EXPECT_EQ(runs, 1);
}

TEST_F(AgentFailuresTest, OutputThatCannotBeStoredInTimeIsAStorageFailure) {
  coordinator_.blobs().RefuseUploads(1'000'000);
  coordinator_.Queue(NewLease("jobs/1/tasks/1"));
  StartAgent(Concatenate);
  const v1::ReportTaskRequest report = WaitForReport();
  EXPECT_EQ(report.failure().error_class(), v1::ERROR_CLASS_STORAGE);
  EXPECT_THAT(report.failure().message(), HasSubstr("no space left"));
}

// Transient errors: a coordinator with a full disk, with a locked database, or still starting.
TEST_F(AgentFailuresTest, ReportIsRepeatedUntilAccepted) {
  for (const grpc::StatusCode code : {grpc::StatusCode::RESOURCE_EXHAUSTED, grpc::StatusCode::INTERNAL,
                                      grpc::StatusCode::UNAVAILABLE, grpc::StatusCode::ABORTED}) {
    coordinator_.AnswerReportsWith(grpc::Status(code, "told to refuse"));
    coordinator_.reports.clear();
    coordinator_.Queue(NewLease("jobs/1/tasks/1"));
    StartAgent(Concatenate);
    EXPECT_TRUE(coordinator_.WaitFor([](const FakeWorkersService& c) { return c.reports.size() >= 8; })) << code;
    coordinator_.AnswerReportsWith(grpc::Status::OK);
    coordinator_.Queue(NewLease("jobs/1/tasks/2"));
    EXPECT_TRUE(
        coordinator_.WaitFor([](const FakeWorkersService& c) { return c.reports.back().task() == "jobs/1/tasks/2"; }));
    StopAgent();
    for (const v1::ReportTaskRequest& report : coordinator_.reports) EXPECT_TRUE(report.has_success());
  }
}

TEST_F(AgentFailuresTest, FailedLeaseCallsDoNotEndTheWorker) {
  for (const grpc::StatusCode code :
       {grpc::StatusCode::FAILED_PRECONDITION, grpc::StatusCode::INTERNAL, grpc::StatusCode::RESOURCE_EXHAUSTED}) {
    coordinator_.AnswerLeasesWith(grpc::Status(code, "told to refuse"), 5);
    coordinator_.reports.clear();
    coordinator_.lease_calls.clear();
    coordinator_.Queue(NewLease("jobs/1/tasks/1"));
    StartAgent(Concatenate);
    EXPECT_TRUE(WaitForReport().has_success()) << code;
    const std::vector<int64_t>& calls = coordinator_.lease_calls;
    EXPECT_EQ(std::count(calls.begin(), calls.end(), calls.front()), 6) << "the number changes only after an answer";
    EXPECT_GT(calls.front(), 0);
  }
}

}  // namespace
}  // namespace tessera
