// Unusable records fail their own jobs and nothing else.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tessera/v1/records.pb.h"
#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

std::string Nested(size_t depth) { return std::string(depth, '[') + std::string(depth, ']'); }

class RecordQuarantineTest : public CoordinatorTest {
 protected:
  // Restarts; returns the quarantined records as "3: reason".
  std::vector<std::string> RestartAndTell() {
    std::vector<std::string> told;
    coordinator_.reset();
    auto coordinator = Coordinator::Open(
        {&store_,
         blobs_.get(),
         &planner_,
         &clock_,
         {},
         [&](int64_t number, const std::string& reason) { told.push_back(std::to_string(number) + ": " + reason); }},
        DispatchOptions());
    EXPECT_TRUE(coordinator.ok()) << coordinator.status();
    coordinator_ = *std::move(coordinator);
    return told;
  }
  // Index of the n-th record of a kind, from 0.
  size_t Find(v1::Record::ChangeCase kind, int n = 0) {
    v1::Record record;
    for (size_t i = 0; i < store_.records.size(); ++i) {
      if (record.ParseFromString(store_.records[i]) && record.change_case() == kind && n-- == 0) return i;
    }
    ADD_FAILURE() << "no such record";
    return 0;
  }
};

TEST_F(RecordQuarantineTest, StatisticsAreBounded) {
  const std::string job = Create(AJob(1));
  const std::string worker = Worker();
  for (const std::string& stats : {Nested(30'000), std::string(100'000, ' ')}) {
    const auto lease = Lease(worker);
    ReportedResult result = Result(*lease);
    result.stats = stats;
    const Status refused = ReportSuccessAndWait(*coordinator_, worker, lease->task, lease->attempt, result);
    EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(refused.message()),
                testing::AnyOf(HasSubstr("statistics: found JSON nested 30000 levels deep, expected at most 64 levels"),
                               HasSubstr("statistics: found 100000 bytes, expected at most 65536")));
    EXPECT_EQ(Task(job, 0).task.error->message, refused.message()) << "the attempt failed";
    clock_.Advance(3);
  }
  WorkAll(worker);
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
}

// Earlier releases did not limit the depth.
TEST_F(RecordQuarantineTest, StoredStatisticsOfAnyDepthAreAccepted) {
  const std::string job = Create(AJob(1));
  const std::string worker = Worker();
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  v1::Record record;
  const size_t at = Find(v1::Record::kTaskSucceeded);
  ASSERT_TRUE(record.ParseFromString(store_.records[at]));
  record.mutable_task_succeeded()->set_stats_json(Nested(1'000'000));
  store_.records[at] = record.SerializeAsString();
  EXPECT_THAT(RestartAndTell(), IsEmpty());
  WorkAll(Worker());
  ASSERT_EQ(Job(job).header.state, JobState::kSucceeded);
  const auto report = nlohmann::json::parse(*blobs_->Read(Job(job).artifacts.at(1).digest));
  EXPECT_TRUE(report["tasks"][0]["stats"].is_null());
}

TEST_F(RecordQuarantineTest, InvalidRecordFailsOnlyItsJob) {
  const std::string first = Create(AJob(1)), second = Create(AJob(1, "other"));
  const std::string worker = Worker();
  ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  store_.records.push_back(store_.records[Find(v1::Record::kTaskSucceeded)]);  // of the first job, again
  const std::string number = std::to_string(store_.records.size());
  EXPECT_THAT(RestartAndTell(), ElementsAre(HasSubstr(number + ": jobs/1/tasks/0: attempt 1 is not the current one")));
  EXPECT_EQ(Job(first).header.state, JobState::kFailed);
  EXPECT_THAT(Job(first).header.error, HasSubstr("stored record " + number + " cannot be used: jobs/1/tasks/0"));
  // Reported once; later starts give the same state.
  EXPECT_THAT(RestartAndTell(), IsEmpty());
  EXPECT_EQ(Job(first).header.state, JobState::kFailed);
  EXPECT_EQ(Create(AJob(2)), "jobs/3");
  WorkAll(Worker());
  EXPECT_EQ(Job(second).header.state, JobState::kSucceeded);
  EXPECT_EQ(Job("jobs/3").header.state, JobState::kSucceeded);
}

// Each record in turn is damaged or unparsable: the coordinator starts, reports it, and other jobs continue.
TEST_F(RecordQuarantineTest, AnyRecordMayBeMissing) {
  const std::string worker = Worker();
  const std::string done = Create(AJob(1)), active = Create(AJob(2, "second"));
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(Succeed(worker, *Lease(worker)).ok());
  const std::string other = Create(AJob(1, "third"));
  ASSERT_EQ(Job(done).header.state, JobState::kSucceeded);
  const std::vector<std::string> all = store_.records;
  for (size_t lost = 0; lost < all.size(); ++lost) {
    for (const std::string found : {MemoryStore::kDamaged, "cannot parse the record"}) {
      SCOPED_TRACE("record " + std::to_string(lost + 1) + " is " + found);
      store_.records = all;
      store_.quarantined.clear();
      store_.records[lost] = found;
      const std::vector<std::string> told = RestartAndTell();
      ASSERT_FALSE(told.empty());
      EXPECT_THAT(told[0], HasSubstr(std::to_string(lost + 1) + ": "));
      EXPECT_EQ(store_.records[lost], found) << "the record is kept";
      ASSERT_TRUE(coordinator_->Tick().ok());
      clock_.Advance(31);  // all leases expire
      ASSERT_TRUE(coordinator_->Tick().ok());
      WorkAll(Worker());
      // Each job ends as usual, except that at most one fails with the reason.
      int failed = 0;
      for (const std::string& name : {done, active, other}) {
        if (Job(name).header.state == JobState::kSucceeded) continue;
        EXPECT_EQ(Job(name).header.state, JobState::kFailed);
        EXPECT_THAT(Job(name).header.error, HasSubstr("cannot be used")) << name;
        ++failed;
      }
      EXPECT_LE(failed, 1);
      EXPECT_EQ(Create(AJob(1, "fourth")), "jobs/4");
      EXPECT_THAT(RestartAndTell(), IsEmpty());
      EXPECT_EQ(coordinator_->jobs().ListJobs(-1, 10).size(), 4u);
    }
  }
}

}  // namespace
}  // namespace tessera
