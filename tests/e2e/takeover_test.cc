// Two coordinators with one state in PostgreSQL: whatever ends the active one, the job goes on at the other.
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <future>
#include <random>

#include "common/rpc/channel.h"
#include "server/store/state_store.h"
#include "tessera/v1/jobs.grpc.pb.h"
#include "tests/e2e/coordinator_pair.h"
#include "tests/e2e/programs.h"
#include "tests/e2e/record_audit.h"
#include "tests/e2e/tcp_proxy.h"
#include "tests/support/servers/postgres_database.h"
#include "tests/support/servers/test_server.h"

namespace tessera::e2e {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

constexpr int kReplaced = 75;  // exit code

class TakeoverTest : public testing::Test {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("postgres");
    Begin(ServerAddress("postgres"));
  }

  // Coordinator 0 serves, 1 stands by; one worker. `database`: URL of a server.
  void Begin(const std::string& database, const std::string& of_active = "") {
    schema_ = "?options=-csearch_path%3Dtakeover" + std::to_string(std::random_device()());
    pair_ = std::make_unique<CoordinatorPair>(folder_.path(), database + schema_,
                                              std::vector<std::string>{"--scene-root", "/"});
    pair_->Start(0, of_active.empty() ? "" : of_active + schema_);
    ASSERT_TRUE(pair_->AwaitActive(0)) << pair_->program(0).Output();
    pair_->Start(1);
    ASSERT_TRUE(pair_->AwaitStandby(1)) << pair_->program(1).Output();
    connection_ = *Connection::Open(pair_->addresses());
  }
  void AddWorker() {
    workers_.push_back(std::make_unique<Program>(
        folder_.path(), TESSERA_WORKER_PROGRAM,
        std::vector<std::string>{"--coordinator", pair_->addresses(), "--threads", "1", "--work",
                                 folder_.path() + "/work-" + std::to_string(workers_.size())}));
  }
  std::string Submit() {
    v1::CreateJobRequest request;
    request.set_scene_path(ToyCity());
    request.set_request_id("the job");
    request.mutable_settings()->set_tiles(4);
    v1::Job job;
    const Status status = connection_->CreateJob(request, &job);
    EXPECT_TRUE(status.ok()) << status;
    return job.name();
  }
  // Waits until the job has tasks of tiles, some of which are done.
  void AwaitMiddle(const std::string& job) {
    ASSERT_TRUE(WaitUntil([&] {
      v1::ListTasksResponse tasks;
      return connection_->ListTasks(job, &tasks).ok() &&
             std::count_if(tasks.tasks().begin(), tasks.tasks().end(),
                           [](const v1::Task& task) { return task.state() == v1::TASK_STATE_SUCCEEDED; }) > 8;
    }));
  }
  // The job ends, with the bytes of a cluster without faults; so does a client that watches it. Then both coordinators
  // are stopped, and the records are checked.
  void ExpectUndisturbed(const std::string& job, Program& watching) {
    const Outcome watched = watching.Wait();
    EXPECT_EQ(watched.exit_code, 0) << watched.output;
    const Outcome fetched =
        Tessera(folder_.path(), {"fetch", job, "--out", folder_.path() + "/out", "--coordinator", pair_->addresses()});
    EXPECT_EQ(fetched.exit_code, 0) << fetched.output;
    EXPECT_TRUE(Content(folder_.path() + "/out/mesh.ply") == Content(UndisturbedMesh()));
    EXPECT_EQ(Submit(), job) << "the request was stored once";
    for (const auto& worker : workers_) EXPECT_TRUE(worker->Running());
    for (int i = 0; i < 2; ++i) {
      pair_->program(i).Signal(SIGTERM);
      pair_->program(i).Wait();
    }
    const RecordAudit audit = AuditRecords(pair_->state());
    EXPECT_THAT(audit.faults(), IsEmpty());
    ASSERT_EQ(audit.jobs().size(), 1u);
    EXPECT_EQ(audit.jobs().at(job).ends, 1);
  }
  std::unique_ptr<Program> Watch(const std::string& job) {
    return std::make_unique<Program>(folder_.path(), TESSERA_PROGRAM,
                                     std::vector<std::string>{"watch", job, "--coordinator", pair_->addresses()});
  }

  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
  std::string schema_;
  std::unique_ptr<CoordinatorPair> pair_;
  std::unique_ptr<Connection> connection_;
  std::vector<std::unique_ptr<Program>> workers_;
};

TEST_F(TakeoverTest, StandbyContinuesTheJobOfAKilledCoordinator) {
  AddWorker();
  const std::string job = Submit();
  const auto watching = Watch(job);
  AwaitMiddle(job);
  pair_->program(0).Kill();
  ASSERT_TRUE(pair_->AwaitActive(1)) << pair_->program(1).Output();
  pair_->Start(0);
  EXPECT_TRUE(pair_->AwaitStandby(0)) << "the one that was killed is the standby now";
  ExpectUndisturbed(job, *watching);
}

// A stopped process does not know for how long it was stopped.
TEST_F(TakeoverTest, StoppedCoordinatorSaysNothingWhenItWakesUp) {
  AddWorker();
  const std::string job = Submit();
  const auto watching = Watch(job);
  AwaitMiddle(job);
  const auto stub = v1::Jobs::NewStub(MakeChannel(pair_->address(0)));
  const auto ask = [&] {
    grpc::ClientContext context;
    SetDeadline(context, 60);
    v1::GetJobRequest request;
    request.set_name(job);
    v1::Job answer;
    return stub->GetJob(&context, request, &answer);
  };
  ASSERT_TRUE(ask().ok());
  pair_->program(0).Signal(SIGSTOP);
  std::vector<std::future<grpc::Status>> asked;
  for (int i = 0; i < 8; ++i) asked.push_back(std::async(std::launch::async, ask));
  ASSERT_TRUE(pair_->AwaitActive(1)) << pair_->program(1).Output();
  pair_->program(0).Signal(SIGCONT);
  for (auto& each : asked) EXPECT_EQ(each.get().error_code(), grpc::StatusCode::UNAVAILABLE);
  const Outcome ended = pair_->program(0).Wait();
  EXPECT_EQ(ended.exit_code, kReplaced) << ended.output;
  EXPECT_THAT(ended.output, HasSubstr("another coordinator has taken over"));
  ExpectUndisturbed(job, *watching);
}

TEST_F(TakeoverTest, SigtermHandsOver) {
  AddWorker();
  const std::string job = Submit();
  const auto watching = Watch(job);
  AwaitMiddle(job);
  pair_->program(0).Signal(SIGTERM);
  ASSERT_TRUE(pair_->AwaitActive(1)) << pair_->program(1).Output();
  EXPECT_EQ(pair_->program(0).Wait().exit_code, 0) << pair_->program(0).Output();
  ExpectUndisturbed(job, *watching);
}

TEST_F(TakeoverTest, StandbyEndsOnSigtermAndListensOnNothing) {
  EXPECT_FALSE(WaitConnected(*MakeChannel(pair_->address(1)), pair_->address(1), 0.3).ok());
  pair_->program(1).Signal(SIGTERM);
  EXPECT_EQ(pair_->program(1).Wait().exit_code, 0) << pair_->program(1).Output();
  EXPECT_EQ(Submit(), "jobs/1") << "the active one is undisturbed";
}

TEST_F(TakeoverTest, StandbyWithOtherStorageIsRefused) {
  pair_->program(1).Kill();
  pair_->Start(1, "", {"--blobs", folder_.path() + "/other"});
  const Outcome blobs = pair_->program(1).Wait();
  EXPECT_EQ(blobs.exit_code, 2) << blobs.output;
  EXPECT_THAT(blobs.output, HasSubstr("lacks the probe object of this state"));
  CoordinatorPair without_roots(folder_.path() + "/without", pair_->state(), {"--blobs", pair_->blobs()});
  const Outcome roots = without_roots.Start(1).Wait();
  EXPECT_EQ(roots.exit_code, 2) << roots.output;
  EXPECT_THAT(roots.output, HasSubstr("--scene-root: found none, expected / as well"));
}

// Coordinators whose database is a server of their own, which the test ends.
class LostDatabaseTest : public TakeoverTest {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("postgres");
    ASSERT_EQ(Database("start").exit_code, 0);
    url_ = Content(folder_.path() + "/postgres/address");
    url_.erase(url_.find_last_not_of('\n') + 1);
  }
  void TearDown() override {
    if (!url_.empty()) Database("stop");
  }
  Outcome Database(const std::string& action) {
    return Program(folder_.path(), TESSERA_START_POSTGRES, {folder_.path() + "/postgres", action}).Wait();
  }
  // Starts whichever coordinator has ended again, until one is active.
  void KeepRunning() {
    ASSERT_TRUE(WaitUntil([&] {
      for (int i = 0; i < 2; ++i) {
        if (!pair_->program(i).Running()) {
          EXPECT_EQ(pair_->program(i).ExitDescription(), "exit code 75") << pair_->program(i).Output();
          pair_->Start(i);
        }
      }
      v1::ListJobsResponse jobs;
      return (pair_->IsActive(0) || pair_->IsActive(1)) && connection_->ListJobs(1, &jobs).ok();
    }));
  }
  std::string url_;
};

TEST_F(LostDatabaseTest, JobGoesOnWhenTheDatabaseIsKilledAndStartedAgain) {
  Begin(url_);
  AddWorker();
  const std::string job = Submit();
  const auto watching = Watch(job);
  AwaitMiddle(job);
  ASSERT_EQ(Database("kill").exit_code, 0);
  ASSERT_EQ(Database("again").exit_code, 0);
  KeepRunning();
  ExpectUndisturbed(job, *watching);
}

// As while its own standby is promoted.
TEST_F(LostDatabaseTest, JobGoesOnWhenTheDatabaseWasReadOnly) {
  Begin(url_);
  AddWorker();
  const std::string job = Submit();
  const auto watching = Watch(job);
  AwaitMiddle(job);
  const std::string writable = url_ + "?options=-cdefault_transaction_read_only%3Doff";  // of this session alone
  const auto set_read_only = [&](const std::string& value) {
    RunPostgres(writable, "ALTER SYSTEM SET default_transaction_read_only = " + value);
    RunPostgres(writable, "SELECT pg_reload_conf()");
  };
  set_read_only("on");
  const Outcome ended = pair_->program(0).Wait();
  EXPECT_EQ(ended.exit_code, kReplaced) << ended.output;
  EXPECT_FALSE(WaitUntil([&] { return !pair_->program(1).Running() || pair_->IsActive(1); }, 10));
  set_read_only("off");
  KeepRunning();
  ExpectUndisturbed(job, *watching);
}

// Like an unplugged cable between the active coordinator and the database.
TEST_F(LostDatabaseTest, StandbyTakesOverFromACoordinatorWithoutTheDatabase) {
  const std::string host = url_.substr(url_.find("127.0.0.1:"));
  TcpProxy proxy(host.substr(0, host.find('/')));
  std::string through = url_;
  through.replace(through.find("127.0.0.1:"), host.find('/'), proxy.address());
  Begin(url_, through);
  AddWorker();
  const std::string job = Submit();
  const auto watching = Watch(job);
  AwaitMiddle(job);
  proxy.Set(TcpProxy::Mode::kStall);
  const Outcome ended = pair_->program(0).Wait();
  EXPECT_EQ(ended.exit_code, kReplaced) << ended.output;
  ASSERT_TRUE(pair_->AwaitActive(1)) << pair_->program(1).Output();
  ExpectUndisturbed(job, *watching);
}

}  // namespace
}  // namespace tessera::e2e
