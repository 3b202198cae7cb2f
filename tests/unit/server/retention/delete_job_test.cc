// Deletion of jobs, and restart of jobs of another version.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/base/version.h"
#include "server/ledger/record_owner.h"
#include "server/retention/reclaimer.h"
#include "server/store/sqlite_store.h"
#include "tessera/v1/records.pb.h"
#include "tests/support/checking_worker.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class DeleteJobTest : public CheckingWorkerTest {
 protected:
  DeleteJobTest() { RestartFromFile(); }
  // Restarts on a SQLite store.
  void RestartFromFile() {
    coordinator_.reset();
    sqlite_.reset();
    sqlite_ = *SqliteStore::Open(folder_.path() + "/state.sqlite", OwnerOfRecord);
    quarantined_.clear();
    coordinator_ = *Coordinator::Open({sqlite_.get(),
                                       blobs_.get(),
                                       &planner_,
                                       &clock_,
                                       {},
                                       [&](int64_t, const std::string& why) { quarantined_.push_back(why); }},
                                      options_);
  }
  std::string Done(int tiles, const std::string& scene = "{}", const std::string& request = "") {
    NewJob job = AJob(tiles, scene);
    job.request = {request, "/scene", job.settings};
    const std::string name = Create(job);
    WorkAll(Worker());
    EXPECT_EQ(Job(name).header.state, JobState::kSucceeded);
    return name;
  }
  // Passes the time with a check every half hour. Returns the number of deleted jobs.
  int Pass(Retention& retention, double seconds) {
    int deleted = 0;
    for (; seconds > 0; seconds -= 1800) {
      clock_.Advance(1800);
      deleted += *Reclaimer(coordinator_->core()).DeleteExpired(retention);
    }
    return deleted;
  }
  Status Delete(const std::string& job) { return coordinator_->jobs().DeleteJob(job, "test"); }
  void FreeAll() {
    while (*Reclaimer(coordinator_->core()).FreeDeleted()) {
    }
  }
  std::vector<std::string> Names() {
    std::vector<std::string> names;
    for (const JobStatus& job : coordinator_->jobs().ListJobs(-1, 100)) names.push_back(job.header.name);
    return names;
  }
  int StoredRecords() {
    int count = 0;
    EXPECT_TRUE(sqlite_->Replay([&](const StoredRecord&) { ++count; }).ok());
    return count;
  }

  std::unique_ptr<SqliteStore> sqlite_;
  std::vector<std::string> quarantined_;
};

TEST_F(DeleteJobTest, DeletedJobIsGoneAndItsNumberIsNotReused) {
  const std::string job = Done(2, "{}", "asked");
  const int records = StoredRecords();
  EXPECT_GT(records, 8);
  ASSERT_TRUE(Delete(job).ok());
  EXPECT_TRUE(Delete(job).ok()) << "a repeated call: the first reply was lost";
  for (int round = 0; round < 3; ++round) {
    EXPECT_THAT(Names(), IsEmpty());
    const Status gone = coordinator_->jobs().GetJob(job).status();
    EXPECT_EQ(gone.code(), absl::StatusCode::kNotFound);
    EXPECT_THAT(std::string(gone.message()), HasSubstr("jobs/1 was deleted"));
    EXPECT_FALSE(coordinator_->jobs().ListTasks(job, 0, 10).ok());
    EXPECT_THAT(coordinator_->jobs().SceneFilesWith(AJob(1).scene_files[0].digest), IsEmpty());
    EXPECT_THAT(quarantined_, IsEmpty());
    if (round == 0) RestartFromFile();  // before anything is freed
    if (round == 1) FreeAll(), RestartFromFile();
  }
  EXPECT_EQ(StoredRecords(), 1) << "the deletion record";
  EXPECT_EQ(Done(2, "{}", "asked"), "jobs/2") << "the request id may be reused";
  EXPECT_FALSE(Task("jobs/2", 0).task.reused) << "its results are not reused";
}

TEST_F(DeleteJobTest, ResultsOfOtherJobsStay) {
  const std::string first = Done(2), second = Done(2), third = Done(2);
  EXPECT_TRUE(Task(second, 0).task.reused);
  for (const std::string& job : {third, first}) {  // the newest with the results, and the one that made them
    ASSERT_TRUE(Delete(job).ok());
    FreeAll();
    EXPECT_THAT(coordinator_->jobs().SceneFilesWith(AJob(1).scene_files[0].digest), SizeIs(1));
    const std::string again = Done(2);
    for (int task = 0; task < 4; ++task) EXPECT_TRUE(Task(again, task).task.reused) << task;
    ASSERT_TRUE(Delete(again).ok());
  }
  RestartFromFile();
  EXPECT_THAT(quarantined_, IsEmpty());
  EXPECT_THAT(Names(), ElementsAre(second));
  EXPECT_TRUE(Task(Done(2), 1).task.reused);
}

TEST_F(DeleteJobTest, RefusesActiveJobsAndBasesOfOtherJobs) {
  const std::string base = Done(1);
  NewJob update = AJob(1, "{\"new\":1}");
  update.settings.update.base = base;
  v1::Record record;  // the fake planner makes too little for the base of an update
  record.mutable_job_accepted()->set_job("jobs/2");
  record.mutable_job_accepted()->mutable_settings()->mutable_update()->set_base(base);
  record.mutable_job_accepted()->set_algorithm_version(kAlgorithmVersion);
  ASSERT_TRUE(sqlite_->Append({record.SerializeAsString()}, Durability::kMachine).ok());
  RestartFromFile();
  const Status needed = Delete(base);
  EXPECT_EQ(needed.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(needed.message()), HasSubstr("delete jobs/2 first"));
  EXPECT_THAT(std::string(Delete("jobs/2").message()), HasSubstr("cancel it first"));
  ASSERT_TRUE(coordinator_->jobs().CancelJob("jobs/2").ok());
  EXPECT_TRUE(Delete("jobs/2").ok());
  EXPECT_TRUE(Delete(base).ok());
  EXPECT_EQ(Delete("jobs/3").code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(Delete("jobs").code(), absl::StatusCode::kInvalidArgument);
}

// More consecutive jobs than kMaxLostJobs.
TEST_F(DeleteJobTest, AnyNumberOfJobsMayBeDeleted) {
  v1::Record record;
  std::vector<std::string> records;
  for (int job = 1; job <= 1500; ++job) {
    record.mutable_job_accepted()->set_job("jobs/" + std::to_string(job));
    records.push_back(record.SerializeAsString());
    record.mutable_job_ended()->set_job("jobs/" + std::to_string(job));
    record.mutable_job_ended()->set_state(v1::JOB_STATE_CANCELLED);
    records.push_back(record.SerializeAsString());
  }
  const std::vector<std::string_view> views(records.begin(), records.end());
  ASSERT_TRUE(sqlite_->Append(views, Durability::kMachine).ok());
  RestartFromFile();
  const std::string kept = Done(1);
  EXPECT_EQ(kept, "jobs/1501");
  for (int job = 1; job <= 1500; ++job) ASSERT_TRUE(Delete("jobs/" + std::to_string(job)).ok());
  RestartFromFile();
  FreeAll();
  RestartFromFile();
  EXPECT_THAT(quarantined_, IsEmpty());
  EXPECT_THAT(Names(), ElementsAre(kept));
  EXPECT_EQ(Job(kept).header.state, JobState::kSucceeded);
}

TEST_F(DeleteJobTest, DeletesExpiredJobs) {
  constexpr double kDay_s = 86400;
  Retention retention(10 * kDay_s);
  const auto pass = [&](double seconds) { return Pass(retention, seconds); };
  const std::string first = Done(1);
  clock_.Advance(kDay_s);
  const std::string second = Done(2);
  const std::string active = Create(AJob(3));
  EXPECT_EQ(pass(8.9 * kDay_s), 0);
  clock_.SetBy(365 * kDay_s);  // corrected before expiry is confirmed
  EXPECT_EQ(pass(Retention::kConfirm_s - 3600), 0);
  clock_.SetBy(-365 * kDay_s);
  EXPECT_EQ(pass(kDay_s / 2), 1);
  EXPECT_THAT(Names(), ElementsAre(active, second));
  EXPECT_EQ(pass(2 * kDay_s), 1);
  EXPECT_THAT(Names(), ElementsAre(active));
  Retention for_ever(0);
  EXPECT_THAT(for_ever.Expired({{"a thing", 1}}, int64_t{1} << 60, 0), IsEmpty());
}

TEST_F(DeleteJobTest, RetentionOfARetriedJobStartsAtItsNewEnd) {
  constexpr double kDay_s = 86400;
  options_.lease_s = options_.stall_s = options_.forget_worker_s = 1e9;
  RestartFromFile();
  Retention retention(10 * kDay_s);
  const auto pass = [&](double seconds) { return Pass(retention, seconds); };
  fails_ = "refine";
  const std::string job = Create(Scene(1));
  Work(job);
  ASSERT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_EQ(pass(10 * kDay_s + Retention::kConfirm_s / 2), 0);
  ASSERT_TRUE(coordinator_->jobs().RetryJob(job, {}).ok());
  EXPECT_EQ(pass(20 * kDay_s), 0) << "the job is active";
  fails_ = "";
  Work(job);
  Mesh(job);
  EXPECT_EQ(pass(10 * kDay_s), 0);
  EXPECT_EQ(pass(kDay_s), 1);
}

// After a stop during removal the next start continues it.
TEST_F(DeleteJobTest, InterruptedRemovalIsCompleted) {
  const std::string kept = Done(1), job = Done(2);
  const int records = StoredRecords();
  ASSERT_TRUE(Delete(job).ok());
  EXPECT_EQ(*sqlite_->RemoveRecords(3), 3);
  RestartFromFile();
  EXPECT_THAT(Names(), ElementsAre(kept));
  FreeAll();
  EXPECT_EQ(*sqlite_->RemoveRecords(1), 0) << "no records left";
  EXPECT_LT(StoredRecords(), records);
  RestartFromFile();
  EXPECT_THAT(quarantined_, IsEmpty());
  EXPECT_THAT(Names(), ElementsAre(kept));
}

// A reused number would mix the records of the new job with those of the deleted one.
TEST_F(DeleteJobTest, NumberIsNotReusedWithoutRemainingRecords) {
  Done(1);
  const std::string job = Done(2);
  ASSERT_TRUE(Delete(job).ok());
  FreeAll();
  coordinator_.reset();
  std::vector<int64_t> last;
  ASSERT_TRUE(sqlite_->Replay([&](const StoredRecord& stored) { last = {stored.number}; }).ok());
  ASSERT_TRUE(sqlite_->Quarantine(last.at(0), "the deletion record").ok());
  RestartFromFile();
  EXPECT_EQ(Done(1, "{\"other\":1}"), "jobs/3");
  for (const char* const never_given : {"jobs/999999999", "jobs/2000000000"}) {  // the second is not a valid name
    v1::Record far;
    far.mutable_job_deleted()->set_job(never_given);
    ASSERT_TRUE(sqlite_->Append({far.SerializeAsString()}, Durability::kMachine).ok());
  }
  RestartFromFile();
  EXPECT_THAT(Names(), ElementsAre("jobs/3", "jobs/1"));
  EXPECT_THAT(quarantined_, ElementsAre(HasSubstr("no such job"), HasSubstr("not a job's name")));
}

// Tasks of the job that recompute results lose their leases and are not leased again.
TEST_F(DeleteJobTest, DeletionEndsRecomputation) {
  for (const bool leased : {false, true}) {
    const std::string job = Create(Scene(1));
    Work(job);
    const Digest mesh = Mesh(job);
    ASSERT_TRUE(RemoveTree(*blobs_->LocalPath(mesh)).ok());
    ASSERT_TRUE(coordinator_->recovery().RemakeArtifact(mesh).ok());
    const std::string worker = Worker();
    std::optional<GrantedLease> lease;
    if (leased) lease = Lease(worker);
    ASSERT_EQ(lease.has_value(), leased);
    ASSERT_TRUE(Delete(job).ok());
    EXPECT_FALSE(Lease(worker));
    if (lease) {
      EXPECT_THAT(*coordinator_->leases().Heartbeat(worker, {{lease->task, lease->attempt, 0.5, ""}}),
                  ElementsAre(lease->task));
      EXPECT_EQ(Succeed(worker, *lease).code(), absl::StatusCode::kNotFound);
    }
    EXPECT_EQ(coordinator_->recovery().RemakeArtifact(mesh).code(), absl::StatusCode::kNotFound);
    clock_.Advance(1e6);
    EXPECT_TRUE(coordinator_->Tick().ok());
    RestartFromFile();
    EXPECT_FALSE(Lease(Worker()));
    FreeAll();
    EXPECT_TRUE(coordinator_->Tick().ok());
    EXPECT_THAT(quarantined_, IsEmpty());
  }
}

// The base is deleted during the submission of an update: no job is created.
TEST_F(DeleteJobTest, UpdateOfAJobDeletedMeanwhileIsRefused) {
  struct DeletingPlanner : BasePlanner {
    std::function<void()> meanwhile;
    StatusOr<std::vector<PlannedTask>> Ingest(const JobSettings& settings, const std::vector<std::string>& files,
                                              const std::vector<int64_t>& size_bytes) override {
      if (!settings.update.base.empty()) meanwhile();
      return BasePlanner::Ingest(settings, files, size_bytes);
    }
  } planner;
  planner.meanwhile = [&] { EXPECT_TRUE(Delete("jobs/1").ok()); };
  based_ = true;
  Open(&planner);
  const std::string base = Create(Scene(1));
  Work(base);
  Mesh(base);
  const auto update = coordinator_->jobs().CreateJob(Scene(1, base));
  EXPECT_EQ(update.status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(update.status().message()), HasSubstr("jobs/1 was deleted"));
  EXPECT_THAT(Names(), IsEmpty());
  coordinator_.reset();
}

// The state of a coordinator with another algorithm version.
TEST_F(DeleteJobTest, JobOfAnotherVersionRestarts) {
  const std::string ended = Done(1), active = Create(AJob(2, "{\"other\":1}"));
  const std::string urgent = Create(AJob(1, "{\"urgent\":1}")), paused = Create(AJob(1, "{\"paused\":1}"));
  std::string worker = Worker();
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  const auto held = Lease(worker);
  ASSERT_TRUE(held);
  EXPECT_EQ(Job(active).tasks_total, 4);
  ASSERT_TRUE(coordinator_->jobs().ChangeJob(urgent, {5, {}}).ok());
  ASSERT_TRUE(coordinator_->jobs().ChangeJob(paused, {9, true}).ok());
  std::vector<std::string> records;
  ASSERT_TRUE(sqlite_
                  ->Replay([&](const StoredRecord& stored) {
                    v1::Record record;
                    ASSERT_TRUE(record.ParseFromString(*stored.content));
                    if (record.has_job_accepted()) record.mutable_job_accepted()->set_algorithm_version("before");
                    records.push_back(record.SerializeAsString());
                  })
                  .ok());
  coordinator_.reset();
  sqlite_.reset();
  ASSERT_TRUE(RemoveTree(folder_.path() + "/state.sqlite").ok());
  ASSERT_TRUE(RemoveTree(folder_.path() + "/state.sqlite-wal").ok());
  {
    auto store = *SqliteStore::Open(folder_.path() + "/state.sqlite", OwnerOfRecord);
    ASSERT_TRUE(store->Append({records.begin(), records.end()}, Durability::kMachine).ok());
  }
  for (int round = 0; round < 2; ++round) {
    RestartFromFile();
    EXPECT_THAT(quarantined_, IsEmpty());
    EXPECT_EQ(Job(active).header.state, JobState::kQueued);
    EXPECT_EQ(Job(active).header.algorithm_version, kAlgorithmVersion);
    EXPECT_THAT(Job(active).header.warnings, ElementsAre(HasSubstr("restarted with algorithm version"))) << "once";
    EXPECT_EQ(Job(ended).header.state, JobState::kSucceeded) << "ended jobs stay";
    EXPECT_EQ(Job(ended).header.algorithm_version, "before");
  }
  EXPECT_EQ(Succeed(worker, *held).code(), absl::StatusCode::kNotFound) << "its plan was dropped";
  ASSERT_TRUE(coordinator_->Tick().ok());
  const auto first = Lease(worker = Worker());
  ASSERT_TRUE(first);
  EXPECT_EQ(first->task, urgent + "/tasks/0") << "it keeps its priority";
  ASSERT_TRUE(Succeed(worker, *first).ok());
  EXPECT_EQ(WorkAll(worker), 2 + 4) << "results of other versions are not used";
  EXPECT_EQ(Job(active).header.state, JobState::kSucceeded);
  EXPECT_EQ(Job(paused).header.state, JobState::kQueued) << "it stays paused";
}

}  // namespace
}  // namespace tessera
