// A job starts when the disk has space for its results.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/fake_coordinator.h"

namespace tessera {
namespace {

using testing::HasSubstr;

// Each refinement task is predicted to store `bytes`.
class StoringPlanner : public FakePlanner {
 public:
  StatusOr<std::vector<PlannedTask>> Tiles(const JobSettings& settings, const std::string& survey,
                                           const std::vector<std::string>& files, const UpdateBase* base,
                                           const FinePart* fine) override {
    auto tasks = FakePlanner::Tiles(settings, survey, files, base, fine);
    for (PlannedTask& task : *tasks) {
      if (task.kind == "refine") task.stored_bytes = bytes;
    }
    return tasks;
  }
  int64_t bytes = 0;
};

constexpr int64_t kTooMuch = int64_t{1} << 41;

class AdmitHeldTest : public CoordinatorTest {
 protected:
  AdmitHeldTest() { Reopen(); }
  void Reopen() {
    coordinator_.reset();
    coordinator_ = *Coordinator::Open({&store_, blobs_.get(), &storing_, &clock_, {}}, options_);
  }
  std::string CreateSurveyed(const std::string& scene, const std::string& worker) {
    const std::string job = Create(AJob(2, scene));
    const auto ingest = Lease(worker);
    EXPECT_TRUE(ingest);
    EXPECT_EQ(ingest->plan.kind, "ingest");
    EXPECT_TRUE(Succeed(worker, *ingest).ok());
    return job;
  }
  StoringPlanner storing_;
};

TEST_F(AdmitHeldTest, JobWithoutDiskSpaceIsNotLeased) {
  storing_.bytes = kTooMuch / 2;
  const std::string worker = Worker(), job = CreateSurveyed("{}", worker);
  EXPECT_FALSE(Lease(worker));
  EXPECT_THAT(Job(job).waiting_for, HasSubstr("not enough disk space for the 2048.0 GiB of its results"));
  EXPECT_THAT(Job(job).waiting_for, HasSubstr("free in " + folder_.path() + "/blobs; it starts when"));
  Reopen();
  EXPECT_FALSE(Lease(Worker())) << "after a restart";
  // Smaller jobs overtake it, and a change of priority does not admit it.
  ASSERT_TRUE(coordinator_->jobs().ChangeJob(job, {5, {}}).ok());
  storing_.bytes = 1;
  const std::string other_worker = Worker(), other = CreateSurveyed("{\"other\":1}", other_worker);
  EXPECT_EQ(WorkAll(other_worker), 3);
  EXPECT_EQ(Job(other).header.state, JobState::kSucceeded);
  EXPECT_EQ(Job(job).tasks_done, 1);
  EXPECT_TRUE(coordinator_->jobs().CancelJob(job).ok());
}

TEST_F(AdmitHeldTest, AdmittedJobKeepsItsSpaceUntilItEnds) {
  storing_.bytes = *blobs_->FreeSpace() / 10 * 3;  // space for two, not for four
  const std::string worker = Worker(), first = CreateSurveyed("{}", worker);
  const auto lease = Lease(worker);
  ASSERT_TRUE(lease);
  const std::string other = Worker("other/boot"), second = Create(AJob(2, "{\"second\":1}"));
  const auto refine = Lease(other);
  ASSERT_TRUE(refine);
  const auto ingest = Lease(worker);
  ASSERT_TRUE(ingest);
  ASSERT_TRUE(Succeed(worker, *ingest).ok());
  EXPECT_FALSE(Lease(worker));
  EXPECT_THAT(Job(second).waiting_for, HasSubstr("of which running jobs need"));
  ASSERT_TRUE(Succeed(worker, *lease).ok());
  ASSERT_TRUE(Succeed(other, *refine).ok());
  WorkAll(worker);
  EXPECT_EQ(Job(first).header.state, JobState::kSucceeded);
  EXPECT_EQ(Job(second).header.state, JobState::kSucceeded);
}

TEST_F(AdmitHeldTest, KnownResultsNeedNoSpace) {
  storing_.bytes = 1;
  const std::string worker = Worker(), job = CreateSurveyed("{}", worker);
  WorkAll(worker);
  ASSERT_EQ(Job(job).header.state, JobState::kSucceeded);
  storing_.bytes = kTooMuch / 2;
  const std::string again = Create(AJob(2, "{}"));
  EXPECT_EQ(Job(again).header.state, JobState::kSucceeded);
}

}  // namespace
}  // namespace tessera
