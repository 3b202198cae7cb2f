// Damaged records: reported with their location and quarantined; the coordinator still starts.
#include "server/retention/verify_state.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include "server/ledger/record_owner.h"
#include "server/store/sqlite_statement.h"
#include "server/store/sqlite_store.h"
#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class VerifyStateTest : public CoordinatorTest {
 protected:
  VerifyStateTest() { OpenFile(); }
  DispatchEnvironment Environment() {
    sqlite_ = *SqliteStore::Open(path_, OwnerOfRecord);
    DispatchEnvironment environment{sqlite_.get(), blobs_.get(), &planner_, &clock_, {}};
    environment.on_record_quarantined = [this](int64_t number, const std::string&) { quarantined_.push_back(number); };
    return environment;
  }
  void Close() {
    coordinator_.reset();
    sqlite_.reset();
  }
  void OpenFile() {
    Close();
    auto coordinator = Coordinator::Open(Environment(), options_);
    ASSERT_TRUE(coordinator.ok()) << coordinator.status();
    coordinator_ = *std::move(coordinator);
  }
  // Same as `tesserad --verify-state`.
  std::vector<std::string> Verify() {
    Close();
    std::vector<std::string> faults;
    const DispatchEnvironment environment = Environment();
    EXPECT_TRUE(VerifyState(*sqlite_, *blobs_, true, [&](const std::string& fault) { faults.push_back(fault); }).ok());
    EXPECT_TRUE(Coordinator::QuarantineUnusable(environment).ok());
    return faults;
  }
  // Flips a byte of a stored record but not its checksum.
  void FlipByte(int64_t number) {
    Close();
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(path_.c_str(), &db), SQLITE_OK);
    const Status flipped =
        RunSql(db, path_,
               "UPDATE records SET content = CAST(substr(content, 1, 4) || x'07' || substr(content, 6) AS BLOB)"
               " WHERE id = " +
                   std::to_string(number));
    EXPECT_TRUE(flipped.ok()) << flipped;
    sqlite3_close(db);
  }

  const std::string path_ = folder_.path() + "/state.sqlite";
  std::unique_ptr<SqliteStore> sqlite_;
  std::vector<int64_t> quarantined_;
};

TEST_F(VerifyStateTest, DamagedRecordIsReportedAndQuarantined) {
  const std::string ended = Create(AJob(1)), worker = Worker();
  WorkAll(worker);
  const std::string active = Create(AJob(1, "{\"other\":1}"));
  ASSERT_TRUE(coordinator_->core().Durable().ok());
  EXPECT_THAT(Verify(), IsEmpty());
  int64_t last = 0;
  ASSERT_TRUE(sqlite_->Replay([&](const StoredRecord& record) { last = record.number; }).ok());
  FlipByte(last);  // the plan of `active`
  const auto faults = Verify();
  const std::string number = std::to_string(last);
  EXPECT_THAT(faults,
              ElementsAre(AllOf(HasSubstr("record " + number + ": row " + number + " of table records is damaged"),
                                HasSubstr("bytes hash to "), HasSubstr(", expected "))));
  EXPECT_THAT(quarantined_, ElementsAre(last));
  EXPECT_THAT(Verify(), IsEmpty()) << "once";
  OpenFile();
  EXPECT_EQ(Job(ended).header.state, JobState::kSucceeded);
  ASSERT_TRUE(coordinator_->Tick().ok());
  WorkAll(Worker());
  EXPECT_EQ(Job(active).header.state, JobState::kSucceeded) << "it was planned again";
}

// The faults that follow from the lost record are reported too, and the job fails with the reason.
TEST_F(VerifyStateTest, JobThatNeedsTheRecordFails) {
  const std::string job = Create(AJob(2)), worker = Worker();
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  ASSERT_TRUE(coordinator_->core().Durable().ok());
  FlipByte(2);  // its plan
  const auto faults = Verify();
  EXPECT_THAT(faults, SizeIs(testing::Gt(1)));
  EXPECT_THAT(faults, Each(HasSubstr("the jobs that need it fail")));
  EXPECT_THAT(Verify(), IsEmpty());
  OpenFile();
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_THAT(Job(job).header.error, AllOf(HasSubstr("stored record 3 cannot be used"), HasSubstr("submit it again")));
}

}  // namespace
}  // namespace tessera
