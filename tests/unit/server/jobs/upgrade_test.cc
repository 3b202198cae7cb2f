// Upgrade of a data folder from an earlier release with another algorithm version.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "common/base/version.h"
#include "server/ledger/record_owner.h"
#include "server/store/sqlite_store.h"
#include "tessera/v1/records.pb.h"
#include "tests/support/checking_worker.h"
#include "tests/support/version3_database.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class UpgradeTest : public CheckingWorkerTest {
 protected:
  UpgradeTest() {
    based_ = true;
    Open(&base_planner_);
    EXPECT_TRUE(EnsureFolder(folder_.path() + "/other").ok());
    EXPECT_TRUE(WriteFileAtomic(folder_.path() + "/other/scene.json", "[]").ok());
  }
  // Converts the stored state to schema version 3 with jobs of algorithm version "before".
  void Upgrade() {
    coordinator_->core().Durable().IgnoreError();
    std::vector<std::string> records;
    for (const std::string& stored : store_.records) {
      v1::Record record;
      ASSERT_TRUE(record.ParseFromString(stored));
      if (record.has_job_accepted()) record.mutable_job_accepted()->set_algorithm_version("before");
      ++kinds_[record.change_case()];
      records.push_back(record.SerializeAsString());
    }
    MakeVersion3Database(path_, records);
    OpenUpgraded();
  }
  void OpenUpgraded() {
    coordinator_.reset();
    sqlite_.reset();
    auto store = SqliteStore::Open(path_, OwnerOfRecord);
    ASSERT_TRUE(store.ok()) << store.status();
    sqlite_ = *std::move(store);
    DispatchEnvironment environment{
        sqlite_.get(), blobs_.get(), &base_planner_, &clock_,
        [this](const auto& record, const ChangedTask&) { told_.push_back(record.ShortDebugString()); }};
    environment.on_record_quarantined = [this](int64_t number, const std::string& why) {
      quarantined_.push_back(std::to_string(number) + ": " + why);
    };
    auto coordinator = Coordinator::Open(environment, options_);
    ASSERT_TRUE(coordinator.ok()) << coordinator.status();
    coordinator_ = *std::move(coordinator);
  }

  const std::string path_ = folder_.path() + "/state.sqlite";
  std::map<int, int> kinds_;  // of records
  std::unique_ptr<SqliteStore> sqlite_;
  std::vector<std::string> quarantined_, told_;
};

TEST_F(UpgradeTest, EndedJobsStayAndActiveOnesRestartOrFail) {
  for (const bool leased : {false, true}) {
    SCOPED_TRACE(leased);
    store_.records.clear();
    for (const char* const end : {"", ".v3", "-wal", "-shm"}) ASSERT_TRUE(RemoveTree(path_ + end).ok());
    coordinator_.reset();
    quarantined_.clear(), told_.clear();
    for (const std::string& path : Blobs()) std::filesystem::remove(path);
    Open(&base_planner_);

    const std::string base = Create(Scene(1));
    Work(base);
    const Digest mesh = Mesh(base);
    fails_ = "solve";
    const std::string failed = Create(Scene(2)), retried = Create(Scene(3));
    Work(failed);
    Work(retried);
    fails_.clear();
    ASSERT_TRUE(coordinator_->jobs().RetryJob(retried, {}).ok());
    Work(retried);
    const Digest retried_mesh = Mesh(retried);
    // A paused job with a priority that waits for its own lost result.
    NewJob other = Scene(4);
    other.scene_path += "/other";
    other.scene_files[0].digest = {Sha256Hex("[]"), 2};
    const std::string paused = Create(other);
    const std::string worker = Worker();
    ASSERT_TRUE(Turn(worker));
    std::filesystem::remove(*blobs_->LocalPath(Task(paused, 0).task.outputs.at(2).digest()));
    ASSERT_TRUE(Turn(worker));
    ASSERT_TRUE(coordinator_->jobs().ChangeJob(paused, {7, true}).ok());
    // An update that waits for its base to recompute a result.
    const std::string update = Create(Scene(1, base));
    ASSERT_TRUE(Turn(worker));
    std::filesystem::remove(*blobs_->LocalPath(Task(base, 1).task.outputs.at(0).digest()));
    ASSERT_TRUE(Turn(worker));
    if (leased) {
      ASSERT_EQ(Lease(worker)->task, base + "/tasks/1");
    }
    Upgrade();
    EXPECT_EQ(kinds_[v1::Record::kJobRetried], 1 + leased);
    EXPECT_EQ(kinds_[v1::Record::kResultLost], 2 * (1 + leased));
    EXPECT_TRUE(FileExists(path_ + ".v3"));
    for (int start = 0; start < 2; ++start) {
      EXPECT_THAT(quarantined_, IsEmpty());
      EXPECT_EQ(Mesh(base), mesh);
      EXPECT_EQ(Mesh(retried), retried_mesh);
      EXPECT_EQ(Job(failed).header.state, JobState::kFailed);
      EXPECT_EQ(Job(paused).header.state, JobState::kQueued);
      EXPECT_EQ(Job(paused).header.priority, 7);
      EXPECT_TRUE(Job(paused).header.paused);
      EXPECT_THAT(Job(paused).header.warnings,
                  ElementsAre(AllOf(HasSubstr("restarted with algorithm version"), HasSubstr("before"))));
      EXPECT_FALSE(Lease(Worker())) << "the base must not recompute results with another version";
      EXPECT_THAT(std::string(coordinator_->jobs().RetryJob(failed, {}).status().message()),
                  AllOf(HasSubstr("was made by algorithm version before"), HasSubstr("submit its scene again")));
      if (start == 0) OpenUpgraded();
    }
    ASSERT_TRUE(coordinator_->core().Durable().ok());
    EXPECT_THAT(told_, Contains(AllOf(HasSubstr("job_restarted"), HasSubstr(paused))));
    ASSERT_TRUE(coordinator_->Tick().ok());
    EXPECT_EQ(Job(update).header.state, JobState::kFailed);
    EXPECT_THAT(Job(update).header.error, AllOf(HasSubstr(base + " was made by algorithm version before"),
                                                HasSubstr("submit its scene as a job without a base")));
    ASSERT_TRUE(coordinator_->jobs().ChangeJob(paused, {{}, false}).ok());
    Work(paused);
    Mesh(paused);
    EXPECT_EQ(Job(base).header.state, JobState::kSucceeded) << "unchanged";
  }
}

}  // namespace
}  // namespace tessera
