// Health service, audit log, call counts and lists of attempts.
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <fstream>
#include <set>
#include <sstream>

#include "common/base/version.h"
#include "common/log/log.h"
#include "common/rpc/blob_client.h"
#include "common/rpc/channel.h"
#include "server/auth/audit.h"
#include "server/grpc/call_observer.h"
#include "server/grpc/coordinator_server.h"
#include "server/ledger/changed_task.h"
#include "server/store/sqlite_store.h"
#include "server/tesserad/logging.h"
#include "tessera/v1/blobs.grpc.pb.h"
#include "tessera/v1/jobs.grpc.pb.h"
#include "tessera/v1/records.pb.h"
#include "tessera/v1/workers.grpc.pb.h"
#include "tests/support/fake_coordinator.h"
#include "tests/unit/server/grpc/raw_call.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

const std::string kForged = "a\n2026-11-23T03:35:06.123Z info audit action=DeleteJob outcome=OK\x1b[2J";

class ObservabilityTest : public CoordinatorTest {
 protected:
  ObservabilityTest() {
    cache_ = *SqliteStore::Open(folder_.path() + "/cache.sqlite");
    EXPECT_TRUE(EnsureFolder(scene_).ok());
    std::ofstream(scene_ + "/scene.json") << "{}";
    EXPECT_TRUE(SetUpLog("off", false).ok());
    Start();
  }
  ~ObservabilityTest() override {
    if (server_) server_->Shutdown(1);
    EXPECT_TRUE(SetUpLog("off", false).ok());
  }
  void Start() {
    ServerEnvironment environment;
    environment.coordinator = coordinator_.get();
    environment.blobs = blobs_.get();
    environment.digests = cache_.get();
    environment.clock = &clock_;
    environment.read_scene = [](const std::string& path, const SceneRequest&,
                                const AllowedFiles&) -> StatusOr<SceneListing> {
      return SceneListing{path, "fake", {"scene.json"}, {}};
    };
    environment.before_reply = [this] { ++replies_; };
    environment_ = environment;
    server_ = *CoordinatorServer::Start("127.0.0.1:0", environment_);
    channel_ = MakeChannel(server_->address(), identity_);
    jobs_ = v1::Jobs::NewStub(channel_);
    workers_ = v1::Workers::NewStub(channel_);
  }
  // Status that Health.Check returns. Parsed by hand, because Debian installs no message classes.
  int Health(const std::string& service) {
    std::string asked, answer;
    if (!service.empty()) asked = "\x0a" + std::string(1, static_cast<char>(service.size())) + service;
    const grpc::Status status = RawCall(channel_, "/grpc.health.v1.Health/Check", asked, {}, &answer);
    if (!status.ok()) return -static_cast<int>(status.error_code());
    return answer.size() == 2 ? answer[1] : 0;  // field 1: status
  }
  static constexpr int kServing = 1, kNotServing = 2;

  // Log lines of `call`.
  template <class Call>
  std::vector<std::string> Logged(const Call& call) {
    testing::internal::CaptureStderr();
    EXPECT_TRUE(SetUpLog("info", false).ok());
    call();
    EXPECT_TRUE(SetUpLog("off", false).ok());
    std::istringstream text(testing::internal::GetCapturedStderr());
    std::vector<std::string> lines;
    for (std::string line; std::getline(text, line);) lines.push_back(line);
    return lines;
  }
  grpc::Status CreateJob(const std::string& name, v1::Job* job, bool validate_only = false) {
    grpc::ClientContext context;
    v1::CreateJobRequest request;
    request.set_scene_path(scene_);
    request.set_display_name(name);
    request.set_validate_only(validate_only);
    request.mutable_settings()->set_tiles(3);
    return jobs_->CreateJob(&context, request, job);
  }
  std::vector<v1::Attempt> Attempts(const std::string& job, int page_size, int* pages) {
    std::vector<v1::Attempt> attempts;
    v1::ListAttemptsRequest request;
    request.set_parent(job);
    request.set_page_size(page_size);
    do {
      grpc::ClientContext context;
      v1::ListAttemptsResponse page;
      const grpc::Status status = jobs_->ListAttempts(&context, request, &page);
      EXPECT_TRUE(status.ok()) << status.error_message();
      EXPECT_LE(page.attempts_size(), page_size);
      EXPECT_LT(page.ByteSizeLong(), 4u << 20) << "gRPC's default limit";
      attempts.insert(attempts.end(), page.attempts().begin(), page.attempts().end());
      request.set_page_token(page.next_page_token());
      ++*pages;
    } while (!request.page_token().empty());
    return attempts;
  }

  const std::string scene_ = folder_.path() + "/scene";
  std::atomic<int> replies_ = 0;  // messages and statuses that left
  std::unique_ptr<SqliteStore> cache_;
  ServerEnvironment environment_;
  std::unique_ptr<CoordinatorServer> server_;
  const std::shared_ptr<CallIdentity> identity_ = std::make_shared<CallIdentity>();  // used by all calls
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::Jobs::Stub> jobs_;
  std::unique_ptr<v1::Workers::Stub> workers_;
};

TEST_F(ObservabilityTest, HealthReflectsJournalState) {
  server_->Shutdown(1);
  options_.durable_wait_s = 0.05;
  Restart();
  Start();
  for (const char* service : {"", "tessera.v1.Jobs", "tessera.v1.Workers", "tessera.v1.Blobs"}) {
    EXPECT_EQ(Health(service), kServing) << service;
  }
  store_.fail = true;
  EXPECT_FALSE(coordinator_->jobs().CreateJob(AJob(1)).ok());
  server_->Tick();
  EXPECT_EQ(Health(""), kNotServing);
  EXPECT_EQ(Health("tessera.v1.Jobs"), kNotServing);
  store_.fail = false;
  while (!coordinator_->core().Durable().ok()) {  // the journal retries after a delay
  }
  server_->Tick();
  EXPECT_EQ(Health(""), kServing);
  EXPECT_EQ(Health("no.such.Service"), -static_cast<int>(grpc::StatusCode::NOT_FOUND));
}

TEST_F(ObservabilityTest, ChangingCallsAreAudited) {
  v1::Job job;
  std::vector<std::string> lines = Logged([&] { ASSERT_TRUE(CreateJob(kForged, &job).ok()); });
  ASSERT_EQ(lines.size(), 1u) << "a name cannot start a log line";
  EXPECT_THAT(lines[0], AllOf(HasSubstr(" info audit action=CreateJob outcome=OK peer=ipv4:127.0.0.1:"),
                              HasSubstr(" job=jobs/1 scene=" + scene_ + " name=\"a\\n2026-"), Not(HasSubstr("\x1b"))));
  const auto call = [&](const auto& method, const auto& request, auto response) {
    return Logged([&] {
      grpc::ClientContext context;
      method(&context, request, &response);
    });
  };
  v1::ChangeJobRequest change;
  change.set_name("jobs/1");
  change.set_priority(7);
  lines = call([&](auto... all) { return jobs_->ChangeJob(all...); }, change, v1::Job());
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_THAT(lines[0], AllOf(HasSubstr("action=ChangeJob outcome=OK"), HasSubstr(" job=jobs/1 priority=7")));
  change.set_priority(1000);
  lines = call([&](auto... all) { return jobs_->ChangeJob(all...); }, change, v1::Job());
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_THAT(lines[0], AllOf(HasSubstr("action=ChangeJob outcome=INVALID_ARGUMENT"), HasSubstr(" error=\"")));
  v1::RetryJobRequest retry;
  retry.set_name("jobs/9");
  retry.set_tile(4);
  EXPECT_THAT(call([&](auto... all) { return jobs_->RetryJob(all...); }, retry, v1::Job()),
              ElementsAre(AllOf(HasSubstr("action=RetryJob outcome=NOT_FOUND"), HasSubstr(" job=jobs/9 tile=4"))));
  v1::CancelJobRequest cancel;
  cancel.set_name("jobs/1");
  EXPECT_THAT(call([&](auto... all) { return jobs_->CancelJob(all...); }, cancel, v1::Job()),
              ElementsAre(HasSubstr("action=CancelJob outcome=OK")));
  v1::DeleteJobRequest deletion;
  deletion.set_name("jobs/1");
  EXPECT_THAT(call([&](auto... all) { return jobs_->DeleteJob(all...); }, deletion, v1::DeleteJobResponse()),
              ElementsAre(HasSubstr("action=DeleteJob outcome=OK")));
  v1::RegisterWorkerRequest registration;
  registration.set_version(kAlgorithmVersion);
  registration.set_host(kForged);
  v1::RegisterWorkerResponse registered;
  lines = Logged([&] {
    grpc::ClientContext context;
    ASSERT_TRUE(workers_->RegisterWorker(&context, registration, &registered).ok());
  });
  identity_->SetWorker(registered.worker(), registered.secret());
  EXPECT_THAT(lines, testing::Each(HasSubstr("host=\"a\\n2026-")));
  EXPECT_THAT(lines.back(), AllOf(HasSubstr("action=RegisterWorker outcome=OK"), HasSubstr(" worker=workers/1-1")));
  ASSERT_TRUE(CreateJob("b", &job).ok());
  ASSERT_TRUE(Lease(registered.worker()));
  std::ofstream(folder_.path() + "/upload") << "some bytes";
  const Digest digest = HashFile(folder_.path() + "/upload").value();
  lines = Logged([&] {
    ASSERT_TRUE(
        BlobClient(channel_, {}, [](double) { return true; }).Send(folder_.path() + "/upload", digest, {}).ok());
  });
  EXPECT_THAT(lines, ElementsAre(AllOf(HasSubstr("action=WriteBlob outcome=OK"), HasSubstr(" blob=" + digest.sha256))));
  v1::UnregisterWorkerRequest leave;
  leave.set_worker("workers/1-1");
  EXPECT_THAT(
      call([&](auto... all) { return workers_->UnregisterWorker(all...); }, leave, v1::UnregisterWorkerResponse())
          .back(),
      AllOf(HasSubstr("action=UnregisterWorker outcome=OK"), HasSubstr(" worker=workers/1-1")));
}

TEST_F(ObservabilityTest, ReadingCallsAreNotAudited) {
  v1::Job job;
  EXPECT_THAT(Logged([&] { ASSERT_TRUE(CreateJob("a", &job, /*validate_only=*/true).ok()); }), IsEmpty());
  EXPECT_THAT(Logged([&] {
                grpc::ClientContext context;
                v1::ListJobsResponse jobs;
                ASSERT_TRUE(jobs_->ListJobs(&context, v1::ListJobsRequest(), &jobs).ok());
              }),
              IsEmpty());
  // All other methods are audited.
  const std::set<std::string> others = {"GetJob",    "ListJobs",      "WatchJob",     "ListTasks",   "ListAttempts",
                                        "LeaseTask", "Heartbeat",     "ReportTask",   "ListWorkers", "StatBlobs",
                                        "ReadBlob",  "QueryWrite",    "GetTransfers", "GetDemand",   "ListTiles",
                                        "ListViews", "ListArtifacts", "ListSettings", "QuoteJob",    "LocatePoint"};
  for (const std::string& method : AllMethods()) {
    EXPECT_NE(IsAudited(method), others.contains(method.substr(method.rfind('/') + 1))) << method;
  }
  EXPECT_FALSE(IsAudited("/other.Service/CreateJob"));
}

// A process that may have lost its state ends there.
TEST_F(ObservabilityTest, NoAnswerLeavesBeforeTheCheckOfTheRightToWrite) {
  v1::Job job;
  ASSERT_TRUE(CreateJob("a", &job).ok());
  for (const std::string& method : AllMethods()) {
    const int before = replies_;
    RawCall(channel_, method, "", {}, nullptr);
    EXPECT_GT(replies_, before) << method;
  }
  const int before = replies_;
  grpc::ClientContext context;
  v1::WatchJobRequest request;
  request.set_name(job.name());
  v1::WatchJobResponse update;
  const auto watch = jobs_->WatchJob(&context, request);
  ASSERT_TRUE(watch->Read(&update));
  EXPECT_GT(replies_, before) << "a message of a stream that goes on";
  context.TryCancel();
}

TEST_F(ObservabilityTest, CallsAndBytesAreCounted) {
  v1::Job job;
  ASSERT_TRUE(CreateJob("a", &job).ok());
  {
    grpc::ClientContext context;
    v1::GetJobRequest get;
    get.set_name("jobs/7");
    EXPECT_FALSE(jobs_->GetJob(&context, get, &job).ok());
  }
  {
    grpc::ClientContext context;
    v1::RegisterWorkerRequest registration;
    registration.set_version(kAlgorithmVersion);
    v1::RegisterWorkerResponse registered;
    ASSERT_TRUE(workers_->RegisterWorker(&context, registration, &registered).ok());
    identity_->SetWorker(registered.worker(), registered.secret());
    ASSERT_TRUE(Lease(registered.worker()));
  }
  const std::string content(2'500'000, 'u');
  std::ofstream(folder_.path() + "/upload", std::ios::binary) << content;
  const Digest digest = HashFile(folder_.path() + "/upload").value();
  BlobClient client(channel_, {}, [](double) { return true; });
  ASSERT_TRUE(client.Send(folder_.path() + "/upload", digest, {}).ok());
  const auto store = *FolderBlobs::Open(folder_.path() + "/other");
  ASSERT_TRUE(client.Fetch(HashFile(scene_ + "/scene.json").value(), *store, {}).ok());
  server_->Shutdown(1);  // all calls have ended
  const auto calls = [&](const std::string& name, grpc::StatusCode code) -> int64_t {
    for (const auto& method : server_->rpc_counts().methods()) {
      if (method->name == name) return method->codes[code];
    }
    return -1;
  };
  EXPECT_EQ(calls("Jobs/CreateJob", grpc::StatusCode::OK), 1);
  EXPECT_EQ(calls("Jobs/GetJob", grpc::StatusCode::OK), 0);
  EXPECT_EQ(calls("Jobs/GetJob", grpc::StatusCode::NOT_FOUND), 1);
  EXPECT_EQ(calls("Blobs/WriteBlob", grpc::StatusCode::OK), 1);
  EXPECT_EQ(calls("Blobs/ReadBlob", grpc::StatusCode::OK), 1);
  EXPECT_EQ(calls("Workers/LeaseTask", grpc::StatusCode::OK), 0);
  EXPECT_EQ(server_->rpc_counts().blob_bytes_written(), static_cast<int64_t>(content.size()));
  EXPECT_EQ(server_->rpc_counts().blob_bytes_read(), 2);
}

TEST_F(ObservabilityTest, EveryAttemptIsListedWithItsOutcome) {
  v1::Job job;
  ASSERT_TRUE(CreateJob("a", &job).ok());
  const std::string one = Worker(), two = Worker("other/boot");
  const auto ingest = Lease(one);
  clock_.Advance(31);  // its lease expires
  ASSERT_TRUE(coordinator_->Tick().ok());
  clock_.Advance(100);
  const std::string three = Worker("third/boot");
  const auto again = Lease(three);
  ASSERT_TRUE(again);
  clock_.Advance(2);
  ASSERT_TRUE(Succeed(three, *again).ok());
  const auto refine = Lease(three);
  ASSERT_TRUE(refine);
  const Status told =
      ReportFailureAndWait(*coordinator_, three, refine->task, 1, {ErrorClass::kInternal, std::string(100'000, 'x')});
  ASSERT_TRUE(told.ok()) << told;
  const auto next = Lease(three);
  ASSERT_TRUE(next);
  for (const int page_size : {1, 2, 1000}) {
    int pages = 0;
    const std::vector<v1::Attempt> attempts = Attempts("jobs/1", page_size, &pages);
    ASSERT_EQ(attempts.size(), 4u);
    EXPECT_GE(pages, 4 / page_size);
    EXPECT_EQ(attempts[0].task(), "jobs/1/tasks/0");
    EXPECT_EQ(attempts[0].worker(), one);
    EXPECT_EQ(attempts[0].machine(), "host/boot");
    EXPECT_EQ(attempts[0].outcome(), v1::ATTEMPT_OUTCOME_LEASE_EXPIRED);
    EXPECT_EQ(attempts[1].attempt(), 2);
    EXPECT_EQ(attempts[1].outcome(), v1::ATTEMPT_OUTCOME_SUCCEEDED);
    EXPECT_EQ(attempts[1].end_time().seconds() - attempts[1].start_time().seconds(), 2);
    std::vector<int> outcomes = {attempts[2].outcome(), attempts[3].outcome()};
    EXPECT_THAT(outcomes, testing::UnorderedElementsAre(v1::ATTEMPT_OUTCOME_FAILED, v1::ATTEMPT_OUTCOME_RUNNING));
    const v1::Attempt& failed = attempts[attempts[2].outcome() == v1::ATTEMPT_OUTCOME_FAILED ? 2 : 3];
    EXPECT_EQ(failed.error().error_class(), v1::ERROR_CLASS_INTERNAL);
    EXPECT_EQ(failed.error().message().size(), 4096u);
    EXPECT_EQ(failed.kind(), "refine");
    EXPECT_GE(failed.tile(), 0);
    for (const v1::Attempt& attempt : attempts) {
      EXPECT_EQ(attempt.has_end_time(), attempt.outcome() != v1::ATTEMPT_OUTCOME_RUNNING);
    }
  }
  ASSERT_TRUE(coordinator_->jobs().CancelJob("jobs/1").ok());
  int pages = 0;
  const auto attempts = Attempts("jobs/1", 10, &pages);
  EXPECT_EQ(std::count_if(attempts.begin(), attempts.end(),
                          [](const auto& each) { return each.outcome() == v1::ATTEMPT_OUTCOME_CANCELLED; }),
            1);
  for (const char* token : {"x", "1", "1.", ".1", "1.2.3", "-1.1"}) {
    grpc::ClientContext context;
    v1::ListAttemptsRequest request;
    request.set_parent("jobs/1");
    request.set_page_token(token);
    v1::ListAttemptsResponse page;
    const auto code = jobs_->ListAttempts(&context, request, &page).error_code();
    const bool plain = std::string(token) == "1" || std::string(token) == "1." || std::string(token) == ".1";
    EXPECT_EQ(code, plain ? grpc::StatusCode::OK : grpc::StatusCode::INVALID_ARGUMENT) << token;
  }
}

// Long messages make pages shorter.
TEST_F(ObservabilityTest, PagesOfAttemptsAreLimited) {
  v1::Job job;
  ASSERT_TRUE(CreateJob("a", &job).ok());
  constexpr int kAttempts = 900;
  for (int i = 0; i < kAttempts; ++i) {
    const std::string worker = Worker();
    const auto lease = Lease(worker);
    ASSERT_TRUE(lease);
    ReportFailureAndWait(*coordinator_, worker, lease->task, lease->attempt,
                         {ErrorClass::kPreempted, std::string(8000, 'x')})
        .IgnoreError();
    ASSERT_TRUE(UnregisterAndWait(*coordinator_, worker).ok());
  }
  int pages = 0;
  EXPECT_EQ(Attempts("jobs/1", 1000, &pages).size(), static_cast<size_t>(kAttempts));
  EXPECT_GT(pages, 1);
}

// Log lines of records contain job, tile, task, attempt and worker.
TEST_F(ObservabilityTest, TaskLogLinesCarryAllFields) {
  v1::Record record;
  record.mutable_attempt_failed()->set_task("jobs/3/tasks/12");
  record.mutable_attempt_failed()->set_attempt(2);
  record.mutable_attempt_failed()->mutable_error()->set_error_class(v1::ERROR_CLASS_MEMORY);
  record.mutable_attempt_failed()->mutable_error()->set_message("it took\nmore");
  const auto lines = Logged([&] { LogRecord(record, {"solve", 7, "workers/1-4"}); });
  EXPECT_THAT(lines, ElementsAre(HasSubstr(" warning attempt failed job=jobs/3 tile=7 task=jobs/3/tasks/12 attempt=2 "
                                           "worker=workers/1-4 kind=solve class=MEMORY error=\"it took\\nmore\"")));
  // The coordinator passes these fields.
  std::vector<std::string> told;
  server_.reset();
  coordinator_.reset();
  coordinator_ = *Coordinator::Open({&store_, blobs_.get(), &planner_, &clock_,
                                     [&](const v1::Record& change, const ChangedTask& task) {
                                       if (!change.has_attempt_started()) return;
                                       told.push_back(task.kind + " " + std::to_string(task.tile) + " " + task.worker);
                                     }},
                                    options_);
  Create(AJob(1));
  const std::string worker = Worker();
  WorkAll(worker);
  coordinator_.reset();
  EXPECT_THAT(told, ElementsAre("ingest -1 " + worker, "refine 0 " + worker, "publish -1 " + worker));
}

}  // namespace
}  // namespace tessera
