// Stored results that are damaged, truncated or deleted: recomputed with the same bytes when needed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tessera/v1/records.pb.h"
#include "tests/support/checking_worker.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

enum class Damage { kFlip, kCut, kDelete };
constexpr Damage kDamages[] = {Damage::kFlip, Damage::kCut, Damage::kDelete};

class LostResultsTest : public CheckingWorkerTest {
 protected:
  void Harm(const std::string& path, Damage damage) {
    if (damage == Damage::kDelete) {
      fs::remove(path);
    } else if (damage == Damage::kCut) {
      fs::resize_file(path, fs::file_size(path) - 1);
    } else {
      std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
      file.put('~');
    }
  }
};

// Damages each stored file in each way after each number of tasks; in half of the cases the coordinator is killed right
// after.
TEST_F(LostResultsTest, AnyLossAtAnyTimeGivesTheSameBytes) {
  planner_.exchange = true;
  Digest expected;
  int cases = 0, remade = 0;
  for (int turns = 0; turns <= 6; ++turns) {
    for (size_t file = 0;; ++file) {
      bool any = false;
      for (const Damage damage : kDamages) {
        ++cases;
        for (const std::string& path : Blobs()) fs::remove(path);
        coordinator_.reset();
        store_.records.clear();
        Restart();
        const std::string job = Create(Scene(2)), worker = Worker();
        for (int i = 0; i < turns; ++i) ASSERT_TRUE(Turn(worker));
        const std::vector<std::string> blobs = Blobs();
        if (file >= blobs.size()) break;
        any = true;
        Harm(blobs[file], damage);
        if (cases % 2 == 0) Restart();
        Work(job);
        const Digest mesh = Mesh(job);
        if (expected.sha256.empty()) expected = mesh;
        ASSERT_EQ(mesh, expected) << turns << " " << blobs[file];
        // The same scene again reuses the intact results and computes the others.
        const std::string again = Create(Scene(2));
        Work(again);
        ASSERT_EQ(Mesh(again), expected) << turns << " " << blobs[file];
        // A fetched artifact is recomputed too.
        if (!blobs_->Verify(mesh).ok()) {
          ASSERT_TRUE(coordinator_->recovery().RemakeArtifact(mesh).ok());
          ASSERT_TRUE(coordinator_->Tick().ok());  // checks the equal result of the other job
          const std::string other = Worker();
          while (Turn(other)) {
          }
          ++remade;
        }
        ASSERT_TRUE(blobs_->Verify(mesh).ok());
        ASSERT_EQ(Job(job).header.state, JobState::kSucceeded);
      }
      if (!any) break;
    }
  }
  EXPECT_GT(cases, 60);
  EXPECT_GT(remade, 0);
}

TEST_F(LostResultsTest, LostReportIsWrittenWithTheSameBytes) {
  const std::string job = Create(Scene(2));
  Work(job);
  const std::vector<NamedDigest> artifacts = Job(job).artifacts;
  ASSERT_EQ(artifacts.back().name, "job.json");
  const Digest report = artifacts.back().digest;
  clock_.SetBy(-3600);  // the report does not depend on it
  // The report omits attempts of recomputation.
  fs::remove(*blobs_->LocalPath(Mesh(job)));
  ASSERT_TRUE(coordinator_->recovery().RemakeArtifact(Mesh(job)).ok());
  fs::remove(*blobs_->LocalPath(report));
  EXPECT_EQ(coordinator_->recovery().RemakeArtifact(report).code(), absl::StatusCode::kUnavailable)
      << "not during recomputation";
  const std::string worker = Worker();
  while (Turn(worker)) {
  }
  for (const Damage damage : kDamages) {
    ASSERT_TRUE(coordinator_->recovery().RemakeArtifact(report).ok())
        << coordinator_->recovery().RemakeArtifact(report);
    ASSERT_TRUE(blobs_->Verify(report).ok());
    Harm(*blobs_->LocalPath(report), damage);
    Restart();
  }
}

TEST_F(LostResultsTest, UpdateHasResultsOfItsBaseRecomputed) {
  based_ = true;
  Digest expected;
  for (const int turns : {0, 1, 2}) {
    for (size_t file = 0; file < 7; ++file) {
      for (const Damage damage : kDamages) {
        for (const std::string& path : Blobs()) fs::remove(path);
        coordinator_.reset();
        store_.records.clear();
        Open(&base_planner_);
        const std::string base = Create(Scene(2));
        Work(base);
        const JobStatus before = Job(base);
        ASSERT_EQ(before.header.state, JobState::kSucceeded) << before.header.error;
        std::string update, worker = Worker();
        if (turns > 0) update = Create(Scene(2, base));
        for (int i = 1; i < turns; ++i) ASSERT_TRUE(Turn(worker));
        const std::vector<std::string> blobs = Blobs();
        ASSERT_LT(file, blobs.size());
        Harm(blobs[file], damage);
        if (turns == 0) update = Create(Scene(2, base));
        if (file % 2 == 0) Open(&base_planner_);
        Work(update);
        const Digest mesh = Mesh(update);
        if (expected.sha256.empty()) expected = mesh;
        ASSERT_EQ(mesh, expected);
        EXPECT_EQ(Job(base).header.state, JobState::kSucceeded);
        EXPECT_EQ(Job(base).header.end_us, before.header.end_us);
        EXPECT_EQ(Job(base).tasks_done, before.tasks_done);
      }
    }
  }
}

TEST_F(LostResultsTest, ReaderWaitsForRecomputationByTheBaseAndMayBeRetried) {
  based_ = true;
  Open(&base_planner_);
  const std::string base = Create(Scene(1));
  Work(base);
  const std::string update = Create(Scene(1, base)), workers[] = {Worker(), Worker()};
  ASSERT_TRUE(Turn(workers[0]));
  fs::remove(*blobs_->LocalPath(Task(base, 1).task.outputs.at(0).digest()));
  ASSERT_TRUE(Turn(workers[0]));  // reports the loss
  int remakes = 0;
  for (int turn = 0; turn < 20 && !HasEnded(Job(update).header.state); ++turn, clock_.Advance(20)) {
    const auto lease = Lease(workers[turn % 2]);
    if (!lease) continue;
    ASSERT_EQ(lease->task, base + "/tasks/1");
    EXPECT_FALSE(Lease(workers[1 - turn % 2])) << "its reader waits";
    ReportedResult result = Made(*lease);
    result.outputs[0].digest = *blobs_->PutBytes("other bytes");
    ASSERT_TRUE(ReportSuccessAndWait(*coordinator_, workers[turn % 2], lease->task, lease->attempt, result).ok());
    ++remakes;
  }
  EXPECT_GT(remakes, 1);
  EXPECT_EQ(Job(update).header.state, JobState::kFailed);
  EXPECT_THAT(Job(update).header.error, HasSubstr("cannot be recomputed"));
  ASSERT_TRUE(coordinator_->jobs().RetryJob(update, {}).ok());
  Open(&base_planner_);  // replay gives the same state
  EXPECT_EQ(Job(update).header.state, JobState::kRunning);
  Work(update);
  EXPECT_EQ(Job(update).header.state, JobState::kSucceeded) << Job(update).header.error;
  EXPECT_EQ(Job(update).tasks_done, Job(update).tasks_total);
}

TEST_F(LostResultsTest, RecomputedResultWithOtherBytesIsRefused) {
  const std::string job = Create(Scene(1)), worker = Worker();
  ASSERT_TRUE(Turn(worker));
  fs::remove(*blobs_->LocalPath(Task(job, 0).task.outputs[1].digest()));
  ASSERT_TRUE(Turn(worker));
  for (int i = 0; i < 10 && !HasEnded(Job(job).header.state); ++i) {
    const auto lease = Lease(worker);
    if (lease) {
      ASSERT_EQ(lease->plan.kind, "ingest") << "its reader waits";
      ReportedResult result = Result(*lease);
      result.outputs[1].digest = *blobs_->PutBytes("other bytes");
      ASSERT_TRUE(ReportSuccessAndWait(*coordinator_, worker, lease->task, lease->attempt, result).ok());
    }
    clock_.Advance(20);
  }
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_THAT(Job(job).header.error, AllOf(HasSubstr("was recomputed with another result"), HasSubstr("output mesh"),
                                           HasSubstr(Sha256Hex("other bytes"))));
}

TEST_F(LostResultsTest, RepeatedLossFailsTheJob) {
  const std::string job = Create(Scene(1)), worker = Worker();
  int turns = 0;
  for (; turns < 100 && !HasEnded(Job(job).header.state); ++turns) {
    if (!Turn(worker)) break;
    for (const StoredFile& output : Task(job, 0).task.outputs) {
      if (output.name == "mesh") fs::remove(*blobs_->LocalPath(output.digest()));
    }
  }
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_EQ(Task(job, 0).task.remakes, 5);
  EXPECT_THAT(Job(job).header.error, AllOf(HasSubstr("recomputed 5 times by 'read the scene' of jobs/1 and lost every"),
                                           HasSubstr(blobs_->root())));
}

// A report is not checked. The first reader of a blob that was never stored finds that, and the job fails after some
// attempts to make it.
TEST_F(LostResultsTest, OutputsThatWereNeverStoredAreFoundByTheirReader) {
  const std::string job = Create(Scene(1)), worker = Worker();
  int turns = 0;
  for (; turns < 100 && !HasEnded(Job(job).header.state); ++turns) {
    const auto lease = Lease(worker);
    if (lease && lease->plan.kind == "ingest") {
      const ReportedResult result = Result(*lease);
      fs::remove(*blobs_->LocalPath(result.outputs.at(1).digest));
      ASSERT_TRUE(ReportSuccessAndWait(*coordinator_, worker, lease->task, lease->attempt, result).ok());
      EXPECT_EQ(Task(job, 0).task.state, TaskState::kSucceeded);
    } else if (lease) {
      ASSERT_TRUE(ReportFailureAndWait(*coordinator_, worker, lease->task, lease->attempt,
                                       {ErrorClass::kLostInput, "lost", {lease->inputs.at(0).file.digest}})
                      .ok());
    }
  }
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_THAT(Job(job).header.error, HasSubstr("recomputed 5 times by 'read the scene' of jobs/1 and lost every"));
  EXPECT_LE(turns, 2 * (1 + options_.retry.max_remakes));
}

TEST_F(LostResultsTest, ChangedSceneFileIsNamed) {
  const std::string job = Create(Scene(1)), worker = Worker();
  ASSERT_TRUE(WriteFileAtomic(folder_.path() + "/scene.json", "[]").ok());
  ASSERT_TRUE(Turn(worker));
  EXPECT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_THAT(Job(job).header.error, AllOf(HasSubstr("scene file scene.json has changed"),
                                           HasSubstr(folder_.path() + "/scene.json was changed after")));
}

// A wrong report of lost inputs does not rerun a task.
TEST_F(LostResultsTest, IntactResultsAreNotRecomputed) {
  const std::string job = Create(Scene(1)), worker = Worker();
  ASSERT_TRUE(Turn(worker));
  const Digest mesh = Task(job, 0).task.outputs[1].digest(), survey = Task(job, 0).task.outputs[0].digest();
  fs::remove(*blobs_->LocalPath(survey));  // not an input of the task
  for (int i = 0; i < 10; ++i) {
    const auto lease = Lease(worker);
    ASSERT_TRUE(lease) << i;
    ASSERT_TRUE(ReportFailureAndWait(*coordinator_, worker, lease->task, lease->attempt,
                                     {ErrorClass::kLostInput, "not there", {mesh, survey}})
                    .ok());
    EXPECT_EQ(Task(job, 0).task.remakes, 0);
    EXPECT_FALSE(Lease(worker)) << "retry delay";
    clock_.Advance(61);
  }
  EXPECT_EQ(Job(job).header.state, JobState::kRunning) << "does not count against the task";
}

}  // namespace
}  // namespace tessera
