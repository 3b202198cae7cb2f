// A bad request, report, record, task or machine does not stop a cluster.
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sqlite3.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <thread>

#include "common/base/version.h"
#include "common/rpc/channel.h"
#include "server/store/sqlite_store.h"
#include "tessera/v1/records.pb.h"
#include "tessera/v1/workers.grpc.pb.h"
#include "tests/e2e/programs.h"

namespace tessera::e2e {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// Whether the scene was read and the tasks of its tiles are planned.
bool HasTiles(Cluster& cluster, const std::string& job) {
  const std::vector<v1::Task> tasks = cluster.Tasks(job);
  return std::any_of(tasks.begin(), tasks.end(),
                     [](const v1::Task& task) { return task.kind() != "inspect" && task.kind() != "ingest"; });
}

// A worker that does what the test says.
class ScriptedWorker {
 public:
  explicit ScriptedWorker(const std::string& coordinator)
      : stub_(v1::Workers::NewStub(MakeChannel(coordinator, identity_))) {
    grpc::ClientContext context;
    v1::RegisterWorkerRequest request;
    request.set_version(kAlgorithmVersion);
    request.set_threads(64);
    request.set_cores(64);
    v1::RegisterWorkerResponse response;
    EXPECT_TRUE(stub_->RegisterWorker(&context, request, &response).ok());
    name_ = response.worker();
    identity_->SetWorker(name_, response.secret());
  }
  v1::Lease Lease() {
    grpc::ClientContext context;
    v1::LeaseTaskRequest request;
    request.set_worker(name_);
    request.set_wait_s(20);
    v1::LeaseTaskResponse response;
    EXPECT_TRUE(stub_->LeaseTask(&context, request, &response).ok());
    return response.lease();
  }
  // Whether the task is to be stopped.
  bool Heartbeat(const v1::Lease& lease) {
    grpc::ClientContext context;
    v1::HeartbeatRequest request;
    request.set_worker(name_);
    request.add_tasks()->set_task(lease.spec().task());
    request.mutable_tasks(0)->set_attempt(lease.attempt());
    request.mutable_tasks(0)->set_stage("hanging");
    v1::HeartbeatResponse response;
    EXPECT_TRUE(stub_->Heartbeat(&context, request, &response).ok());
    return response.stop_tasks_size() > 0;
  }
  grpc::Status Report(const v1::Lease& lease, v1::ReportTaskRequest report) {
    grpc::ClientContext context;
    report.set_worker(name_);
    report.set_task(lease.spec().task());
    report.set_attempt(lease.attempt());
    v1::ReportTaskResponse response;
    return stub_->ReportTask(&context, report, &response);
  }

 private:
  const std::shared_ptr<CallIdentity> identity_ = std::make_shared<CallIdentity>();
  std::unique_ptr<v1::Workers::Stub> stub_;
  std::string name_;
};

class ClusterFaultsTest : public testing::Test {
 protected:
  TempFolder folder_ = TempFolder::Create(testing::TempDir()).value();
};

TEST_F(ClusterFaultsTest, DeeplyNestedReportIsRefused) {
  Cluster cluster(folder_.path());
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  ScriptedWorker worker(cluster.address());
  v1::ReportTaskRequest deep, broken;
  deep.mutable_success()->set_stats_json(std::string(30'000, '[') + std::string(30'000, ']'));
  const v1::Lease first = worker.Lease();
  const grpc::Status refused = worker.Report(first, deep);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(refused.error_message(), HasSubstr("found JSON nested 30000 levels deep, expected at most 64 levels"));
  broken.mutable_failure()->set_error_class(v1::ERROR_CLASS_INPUT);
  // It is alone: its word counts when it says so twice of a task.
  const auto has_failed = [&] {
    const std::vector<v1::Task> tasks = cluster.Tasks(job);
    return std::any_of(tasks.begin(), tasks.end(),
                       [](const v1::Task& task) { return task.state() == v1::TASK_STATE_FAILED; });
  };
  for (int reports = 0; reports < 10 && !has_failed(); ++reports) {
    EXPECT_TRUE(worker.Report(worker.Lease(), broken).ok());
  }
  EXPECT_EQ(cluster.Await(job).state(), v1::JOB_STATE_FAILED);
  cluster.coordinator().Kill();
  cluster.StartCoordinator();
  EXPECT_EQ(cluster.Await(job).state(), v1::JOB_STATE_FAILED);
}

// Journal writes fail while a backup locks the database or the disk is full.
TEST_F(ClusterFaultsTest, JobSurvivesTemporaryJournalFailure) {
  Cluster cluster(folder_.path());
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  cluster.AddWorker();
  ASSERT_TRUE(WaitUntil([&] { return HasTiles(cluster, job); }));
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open((cluster.data() + "/state.sqlite").c_str(), &db), SQLITE_OK);
  sqlite3_busy_timeout(db, 10'000);
  ASSERT_EQ(sqlite3_exec(db, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
  EXPECT_TRUE(
      WaitUntil([&] { return cluster.coordinator().Output().find("journal write failed") != std::string::npos; }, 30));
  std::this_thread::sleep_for(std::chrono::seconds(4));  // longer than a lease
  sqlite3_close(db);
  EXPECT_EQ(cluster.Await(job).state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_THAT(cluster.coordinator().Output(), HasSubstr("journal writes succeed again"));
  for (const v1::Task& task : cluster.Tasks(job)) EXPECT_EQ(task.attempt(), 1) << task.title();
  EXPECT_TRUE(cluster.workers()[0]->Running());
  EXPECT_TRUE(Content(cluster.Fetch(job) + "/mesh.ply") == Content(UndisturbedMesh()));
}

TEST_F(ClusterFaultsTest, UnusableRecordIsQuarantinedAtStart) {
  Cluster cluster(folder_.path());
  const std::string spoiled = cluster.Submit(ToyCity(), 4).name(), other = cluster.Submit(ToyCity(), 2).name();
  cluster.coordinator().Kill();
  v1::Record twice;
  twice.mutable_job_accepted()->set_job(spoiled);
  int64_t last = 0;
  {
    const auto store = SqliteStore::Open(cluster.data() + "/state.sqlite").value();
    ASSERT_TRUE(store->Replay([&](const StoredRecord& record) { last = record.number; }).ok());
    ASSERT_TRUE(store->Append({"rot", twice.SerializeAsString()}, Durability::kMachine).ok());
  }
  cluster.StartCoordinator();
  const std::string first = std::to_string(last + 1), second = std::to_string(last + 2);
  EXPECT_THAT(cluster.coordinator().Output(),
              testing::AllOf(HasSubstr("record quarantined record=" + first + " reason=\"cannot parse the record\""),
                             HasSubstr("record quarantined record=" + second + " reason=\"the next job is jobs/3")));
  const v1::Job job = cluster.Await(spoiled);
  EXPECT_EQ(job.state(), v1::JOB_STATE_FAILED);
  EXPECT_THAT(job.error(), HasSubstr("stored record " + second + " cannot be used: the next job is jobs/3"));
  cluster.AddWorker();
  EXPECT_EQ(cluster.Await(other).state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(cluster.Submit(ToyCity(), 4).name(), "jobs/3");
}

TEST_F(ClusterFaultsTest, RequestIdReusedForAnotherJobIsRefused) {
  Cluster cluster(folder_.path());
  EXPECT_EQ(cluster.Submit(ToyCity(), 4, "night").name(), "jobs/1");
  cluster.coordinator().Kill();
  cluster.StartCoordinator();
  EXPECT_EQ(cluster.Submit(ToyCity(), 4, "night").name(), "jobs/1");
  v1::CreateJobRequest request;
  request.set_request_id("night");
  request.set_scene_path(ToyCity());
  request.mutable_settings()->set_tiles(9);
  request.mutable_settings()->mutable_update()->set_base("jobs/1");
  v1::Job job;
  const Status refused = cluster.connection().CreateJob(request, &job);
  EXPECT_EQ(refused.code(), absl::StatusCode::kAlreadyExists);
  EXPECT_THAT(std::string(refused.message()),
              testing::AllOf(HasSubstr("tiles: found 9, expected 4"), HasSubstr("update.base: found \"jobs/1\"")));
}

TEST_F(ClusterFaultsTest, JobReadsItsOwnSceneWhenACopyIsRemoved) {
  Cluster cluster(folder_.path());
  const std::string copy = folder_.path() + "/copy";
  fs::copy(ToyCity(), copy, fs::copy_options::recursive);
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  v1::Job of_copy = cluster.Submit(copy, 4);
  ASSERT_TRUE(cluster.connection().CancelJob(of_copy.name(), &of_copy).ok());
  ASSERT_TRUE(RemoveTree(copy).ok());
  cluster.AddWorker({"--no-shared-storage"});
  const v1::Job ended = cluster.Await(job);
  EXPECT_EQ(ended.state(), v1::JOB_STATE_SUCCEEDED) << ended.error();
}

TEST_F(ClusterFaultsTest, StalledTaskIsRetriedByAnotherWorker) {
  Cluster cluster(folder_.path(), 3, {"--stall-s", "2"});
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  ScriptedWorker hanging(cluster.address());
  const v1::Lease lease = hanging.Lease();
  ASSERT_FALSE(hanging.Heartbeat(lease));
  ASSERT_TRUE(WaitUntil([&] { return hanging.Heartbeat(lease); }, 60));
  EXPECT_THAT(cluster.Tasks(job).at(0).error().message(), HasSubstr("showed no progress for"));
  cluster.AddWorker();
  const v1::Job ended = cluster.Await(job);
  EXPECT_EQ(ended.state(), v1::JOB_STATE_SUCCEEDED) << ended.error();
}

// The tile is published unrefined and flagged; after a retry the result equals that of a job without the failure.
TEST_F(ClusterFaultsTest, FailingTileIsQuarantinedAndCanBeRetried) {
  Cluster cluster(folder_.path());
  const auto tessera = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--coordinator", cluster.address()});
    return Tessera(folder_.path(), arguments);
  };
  const std::string job = cluster.Submit(ToyCity(), 4).name();
  Program& reader = cluster.AddWorker();
  ASSERT_TRUE(WaitUntil([&] { return HasTiles(cluster, job); }));
  reader.Signal(SIGTERM);
  reader.Wait();
  ScriptedWorker small(cluster.address());
  v1::ReportTaskRequest died;
  died.mutable_failure()->set_error_class(v1::ERROR_CLASS_MEMORY);
  died.mutable_failure()->set_message("killed");
  const v1::Lease lease = small.Lease();
  ASSERT_TRUE(small.Report(lease, died).ok());
  const v1::Lease second = small.Lease();
  ASSERT_EQ(second.spec().task(), lease.spec().task());
  ASSERT_TRUE(small.Report(second, died).ok());
  cluster.AddWorker();
  const Outcome watched = tessera({"watch", job});
  EXPECT_EQ(watched.exit_code, 5) << watched.output;
  EXPECT_THAT(watched.output, HasSubstr("was quarantined: '" + lease.spec().title() + "' failed (memory): killed"));
  const std::string partial = cluster.Fetch(job);
  EXPECT_THAT(Content(partial + "/report.json"), HasSubstr("is quarantined"));
  EXPECT_THAT(Content(partial + "/tiles/index.json"), HasSubstr("\"quarantined\": true"));
  EXPECT_FALSE(Content(partial + "/mesh.ply") == Content(UndisturbedMesh()));
  const Outcome again = tessera({"retry", job, "--watch"});
  EXPECT_EQ(again.exit_code, 0) << again.output;
  EXPECT_TRUE(Content(cluster.Fetch(job) + "/mesh.ply") == Content(UndisturbedMesh()));
}

// Each worker has a host name of its own, which goes with it.
TEST_F(ClusterFaultsTest, PreemptedMachinesDoNotFailATask) {
  const auto machine = [](int i) -> std::vector<std::string> {
    const std::string start = "hostname spot-" + std::to_string(i) + " && exec \"$0\" \"$@\"";
    if (::geteuid() == 0) return {"/usr/bin/unshare", "--uts", "/bin/sh", "-c", start};
    return {"/usr/bin/unshare", "--map-root-user", "--uts", "/bin/sh", "-c", start};
  };
  std::vector<std::string> nothing = machine(0);
  nothing.push_back("/bin/true");
  if (Program(folder_.path(), nothing.front(), {nothing.begin() + 1, nothing.end()}).Wait().exit_code != 0) {
    GTEST_SKIP() << "no host names of their own here";
  }
  Cluster cluster(folder_.path(), 1);
  const std::string job = cluster.Submit(ToyCity(), 1).name();
  constexpr int kLost = 4;
  const auto ingest = [&] {
    for (const v1::Task& task : cluster.Tasks(job)) {
      if (task.kind() == "ingest") return task;
    }
    return v1::Task();
  };
  for (int i = 0; i < kLost; ++i) {
    Program& worker = cluster.AddWorker({}, machine(i));
    // Of one task every time: nobody else is there.
    ASSERT_TRUE(WaitUntil([&] {
      const v1::Task task = ingest();
      return task.state() == v1::TASK_STATE_LEASED && task.attempt() == i + 1;
    }));
    worker.Kill();
  }
  cluster.AddWorker();
  const v1::Job ended = cluster.Await(job);
  EXPECT_EQ(ended.state(), v1::JOB_STATE_SUCCEEDED) << ended.error();
  EXPECT_EQ(ingest().attempt(), kLost + 1);
}

}  // namespace
}  // namespace tessera::e2e
