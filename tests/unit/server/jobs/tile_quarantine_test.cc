// Quarantine of tiles whose refinement fails, and retries.
#include "server/jobs/tile_quarantine.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "common/base/refusal.h"
#include "server/jobs/coordinator.h"
#include "tessera/v1/records.pb.h"
#include "tests/support/fake_coordinator.h"
#include "tests/support/row_planner.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

class TileQuarantineTest : public CoordinatorTest {
 protected:
  TileQuarantineTest() { Open(); }

  void Open() {
    coordinator_.reset();
    coordinator_ = *Coordinator::Open({&store_, blobs_.get(), &row_, &clock_, {}}, options_);
  }
  Status SucceedAny(const std::string& worker, const GrantedLease& lease) {
    const InternedString& kind = lease.plan.kind;
    if (kind != kSolveKind && kind != kSplitKind && kind != kCropKind) return Succeed(worker, lease);
    ReportedResult result;
    for (const char* name : kind == kSplitKind  ? std::vector{kCityFile, kMovedFile, kSurveyFile}
                            : kind == kCropKind ? std::vector{kViewsFile}
                                                : std::vector{kStateFile}) {
      result.outputs.push_back({name, *blobs_->PutBytes(name + lease.key)});
    }
    return ReportSuccessAndWait(*coordinator_, worker, lease.task, lease.attempt, result);
  }
  // Runs all tasks, failing those in `bad` with `error_class` until they are no longer retried. Returns the runs by
  // name.
  std::map<std::string, int> WorkAll(const std::vector<std::string>& bad,
                                     ErrorClass error_class = ErrorClass::kPoison) {
    std::map<std::string, int> runs;
    const std::string worker = Worker();
    while (true) {
      const auto lease = Lease(worker);
      if (!lease) return runs;
      ++runs[lease->plan.name];
      const bool is_bad = std::find(bad.begin(), bad.end(), lease->plan.name) != bad.end();
      EXPECT_TRUE((is_bad ? Fail(worker, *lease, error_class) : SucceedAny(worker, *lease)).ok());
    }
  }
  // Hashes of the published states of the tiles.
  std::string Published(const std::string& job) { return Job(job).artifacts.at(0).digest.sha256; }

  RowPlanner row_;
};

TEST_F(TileQuarantineTest, OtherTilesContinueWithoutRepeatedWork) {
  const std::string job = Create(AJob(5));
  const std::map<std::string, int> runs = WorkAll({"solve tile 0 step 1"});
  const JobStatus status = Job(job);
  EXPECT_EQ(status.header.state, JobState::kPartial);
  EXPECT_THAT(status.header.error, AllOf(HasSubstr("tile 0 was quarantined: 'solve tile 0 step 1' failed"),
                                         HasSubstr("(poison): it broke")));
  EXPECT_THAT(status.header.warnings, ElementsAre(HasSubstr("tile 0 was quarantined")));
  EXPECT_EQ(status.tiles_done, 4);
  EXPECT_EQ(status.tiles_total, 5);
  EXPECT_EQ(status.progress, 1);
  EXPECT_EQ(status.tasks_done, status.tasks_total);
  ASSERT_EQ(status.artifacts.size(), 2u);
  const auto report = nlohmann::json::parse(*blobs_->Read(status.artifacts[1].digest));
  EXPECT_EQ(report["state"], "partial");
  EXPECT_EQ(report["quarantined"][0]["tile"], 0);
  // Only tasks of adjacent tiles may run again.
  EXPECT_LE(runs.at("solve tile 1 step 1"), 2);
  EXPECT_EQ(runs.at("solve tile 1 step 0"), 1);
  for (const int tile : {2, 3, 4}) EXPECT_EQ(runs.at("solve tile " + std::to_string(tile) + " step 1"), 1);
  EXPECT_FALSE(runs.contains("solve tile 0 step 2"));
  Open();
  EXPECT_EQ(Job(job).header.state, JobState::kPartial);
  EXPECT_EQ(coordinator_->jobs()
                .CreateJob([&] {
                  NewJob update = AJob(5);
                  update.settings.update.base = job;
                  return update;
                }())
                .status()
                .code(),
            absl::StatusCode::kFailedPrecondition)
      << "a partial job is no base of an update";
}

// For any number of stored records.
TEST_F(TileQuarantineTest, SameEndAfterReplayOfAnyPrefix) {
  const std::string job = Create(AJob(3));
  WorkAll({"solve tile 1 step 1"});
  ASSERT_EQ(Job(job).header.state, JobState::kPartial);
  const std::string published = Published(job);
  coordinator_.reset();  // stores the remaining records
  const std::vector<std::string> all = store_.records;
  for (size_t size = 1; size < all.size(); ++size) {
    coordinator_.reset();
    store_.records.assign(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(size));
    Open();
    clock_.Advance(31);  // all leases expire
    ASSERT_TRUE(coordinator_->Tick().ok());
    clock_.Advance(10);
    WorkAll({"solve tile 1 step 1"});
    EXPECT_EQ(Job(job).header.state, JobState::kPartial) << "after " << size << " records";
    EXPECT_EQ(Published(job), published) << "after " << size << " records";
  }
}

TEST_F(TileQuarantineTest, TileWithFailedCutHasNoSteps) {
  const std::string job = Create(AJob(3));
  const std::map<std::string, int> runs = WorkAll({"cut tile 2"});
  EXPECT_EQ(Job(job).header.state, JobState::kPartial);
  EXPECT_FALSE(runs.contains("solve tile 2 step 0"));
  EXPECT_TRUE(runs.contains("solve tile 1 step 2"));
}

// Also those of the tasks that the new plan replaced.
TEST_F(TileQuarantineTest, AttemptsOfATileAreListed) {
  const std::string job = Create(AJob(4));
  WorkAll({"solve tile 1 step 1"});
  const auto all = coordinator_->jobs().ListAttempts(job, 0, 1, 1000);
  ASSERT_TRUE(all.ok());
  std::vector<std::pair<std::string, int>> expected;
  for (const AttemptStatus& each : all->attempts) {
    if (each.tile == 1) expected.emplace_back(TaskName(each.task), each.number);
  }
  const auto failed = [](const AttemptStatus& each) {
    return each.title == "solve tile 1 step 1" && OutcomeOf(each.attempt) == AttemptOutcome::kFailed;
  };
  for (const int page_size : {1, 2, 1000}) {
    std::vector<std::pair<std::string, int>> seen;
    int task = 0, number = 1, failures = 0;
    while (task >= 0) {
      const auto page = coordinator_->jobs().ListAttempts(job, task, number, page_size, 1);
      ASSERT_TRUE(page.ok());
      for (const AttemptStatus& each : page->attempts) {
        seen.emplace_back(TaskName(each.task), each.number);
        failures += failed(each);
      }
      task = page->next_task;
      number = page->next_number;
    }
    EXPECT_EQ(seen, expected) << page_size;
    EXPECT_GT(failures, 0);
  }
  EXPECT_TRUE(coordinator_->jobs().ListAttempts(job, 0, 1, 1000, 77)->attempts.empty());
  EXPECT_TRUE(coordinator_->jobs().ListAttempts(job, 0, 1, 1000, -1)->attempts.empty());
  Open();
  EXPECT_EQ(coordinator_->jobs().ListAttempts(job, 0, 1, 1000, 1)->attempts.size(), expected.size());
}

TEST_F(TileQuarantineTest, AttemptsOfTheOldPlanAreStopped) {
  const std::string job = Create(AJob(3)), worker = Worker(), other = Worker();
  std::optional<GrantedLease> bad, beside;
  while (!bad || !beside) {
    const auto lease = Lease(worker);
    ASSERT_TRUE(lease);
    if (lease->plan.name == "solve tile 0 step 0") {
      bad = lease;
    } else if (lease->plan.name == "solve tile 1 step 0") {
      beside = lease;
    } else {
      ASSERT_TRUE(SucceedAny(worker, *lease).ok());
    }
  }
  ASSERT_TRUE(Fail(worker, *bad, ErrorClass::kPoison).ok());
  EXPECT_THAT(*coordinator_->leases().Heartbeat(worker, {{beside->task, 1, 0.5, ""}}), ElementsAre(beside->task));
  EXPECT_EQ(SucceedAny(worker, *beside).code(), absl::StatusCode::kFailedPrecondition);
  WorkAll({});
  EXPECT_EQ(Job(job).header.state, JobState::kPartial);
}

TEST_F(TileQuarantineTest, InvalidInputCityTaskAndLastTileFailTheJob) {
  const std::string input = Create(AJob(3, "a"));
  WorkAll({"solve tile 1 step 1"}, ErrorClass::kInput);
  clock_.Advance(10);
  WorkAll({"solve tile 1 step 1"}, ErrorClass::kInput);  // second report
  EXPECT_EQ(Job(input).header.state, JobState::kFailed);
  const std::string publish = Create(AJob(3, "b"));
  WorkAll({"publish"});
  EXPECT_EQ(Job(publish).header.state, JobState::kFailed);
  const std::string all = Create(AJob(2, "c"));
  WorkAll({"solve tile 0 step 1", "solve tile 1 step 1", "solve tile 1 step 0"});
  EXPECT_EQ(Job(all).header.state, JobState::kFailed);
}

TEST_F(TileQuarantineTest, RetriedJobCountsAsActive) {
  const std::string job = Create(AJob(4));
  WorkAll({"solve tile 0 step 1"});
  ASSERT_EQ(Job(job).header.state, JobState::kPartial);
  options_.limits.of_client = 1;
  Open();
  const std::string other = Create(AJob(2, "other"));
  const Status refused = coordinator_->jobs().RetryJob(job, {}).status();
  EXPECT_EQ(LimitOf(refused).flag, "--max-jobs-of-client") << refused;
  EXPECT_EQ(Job(job).header.state, JobState::kPartial);
  EXPECT_EQ(coordinator_->jobs().RetryJob(other, {}).status().code(), absl::StatusCode::kFailedPrecondition)
      << "limits do not count ended jobs";
  ASSERT_TRUE(coordinator_->jobs().CancelJob(other).ok());
  EXPECT_TRUE(coordinator_->jobs().RetryJob(job, {}).ok());
}

TEST_F(TileQuarantineTest, RetriedJobEndsLikeAnUndisturbedOne) {
  const std::string job = Create(AJob(4));
  EXPECT_EQ(coordinator_->jobs().RetryJob(job, {}).status().code(), absl::StatusCode::kFailedPrecondition);
  WorkAll({"solve tile 0 step 1", "cut tile 3"});
  ASSERT_EQ(Job(job).header.state, JobState::kPartial);
  EXPECT_EQ(Job(job).tiles_done, 2);
  EXPECT_EQ(coordinator_->jobs().RetryJob(job, 1).status().code(), absl::StatusCode::kFailedPrecondition);
  ASSERT_TRUE(coordinator_->jobs().RetryJob(job, 3).ok());
  EXPECT_EQ(Job(job).header.state, JobState::kRunning);
  EXPECT_EQ(Job(job).header.error, "");
  Open();
  std::map<std::string, int> runs = WorkAll({});
  EXPECT_EQ(runs.at("cut tile 3"), 1);
  EXPECT_EQ(Job(job).header.state, JobState::kPartial) << "tile 0 is quarantined";
  EXPECT_EQ(Job(job).tiles_done, 3);
  ASSERT_TRUE(coordinator_->jobs().RetryJob(job, {}).ok());
  runs = WorkAll({});
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
  EXPECT_TRUE(Job(job).header.warnings.empty());
  EXPECT_EQ(Job(job).tiles_done, 4);
  EXPECT_FALSE(runs.contains("solve tile 3 step 0")) << "not adjacent to tile 0";
  const std::string published = Published(job);
  // A job of the same scene without failures has the same result and reuses all tasks.
  const std::string again = Create(AJob(4));
  EXPECT_TRUE(WorkAll({}).empty());
  EXPECT_EQ(Published(again), published);
}

// The first tile of a shared crop is quarantined, and the others are cropped without it.
TEST_F(TileQuarantineTest, TilesContinueWithoutTheirSharedCrop) {
  row_.crops = true;
  const std::string job = Create(AJob(3));
  const std::map<std::string, int> runs = WorkAll({"crop all tiles"});
  EXPECT_EQ(Job(job).header.state, JobState::kPartial);
  EXPECT_THAT(Job(job).header.error, HasSubstr("tile 0 was quarantined: 'crop all tiles' failed"));
  EXPECT_EQ(Job(job).tiles_done, 2);
  EXPECT_FALSE(runs.contains("crop tile 0"));
  EXPECT_EQ(runs.at("crop tile 2"), 1);
  EXPECT_FALSE(runs.contains("solve tile 0 step 0"));
  EXPECT_EQ(runs.at("solve tile 1 step 2"), 1);
}

// The tile that would be quarantined is quarantined already, because of a later step.
TEST_F(TileQuarantineTest, EarlierTaskWhoseResultIsLostAndThatFailsThenEnds) {
  row_.crops = true;
  for (const std::string made : {"crop all tiles", "solve tile 0 step 1"}) {
    SCOPED_TRACE(made);
    const std::string job = Create(AJob(3, made)), worker = Worker();
    int turns = 0, failures = 0;
    std::optional<Digest> result;
    bool lost = false;
    for (; turns < 200 && !HasEnded(Job(job).header.state); ++turns) {
      clock_.Advance(61);  // retry delays
      const auto lease = Lease(worker);
      if (!lease) continue;
      const std::string& name = lease->plan.name;
      if ((name == made && lost) || name == "solve tile 0 step 2") {
        failures += name == made;
        ASSERT_TRUE(Fail(worker, *lease, ErrorClass::kPoison).ok());
      } else if (lease->plan.kind == kSolveKind && !lost && !Job(job).header.warnings.empty()) {
        lost = true;
        fs::remove(*blobs_->LocalPath(*result));
        ASSERT_TRUE(ReportFailureAndWait(*coordinator_, worker, lease->task, lease->attempt,
                                         {ErrorClass::kLostInput, "lost", {*result}})
                        .ok());
      } else {
        const char* const file = lease->plan.kind == kCropKind ? kViewsFile : kStateFile;
        if (name == made) result = *blobs_->PutBytes(file + lease->key);
        ASSERT_TRUE(SucceedAny(worker, *lease).ok());
      }
    }
    EXPECT_TRUE(lost);
    EXPECT_GT(failures, 0);
    EXPECT_EQ(Job(job).header.state, JobState::kPartial) << "after " << turns << " turns";
    EXPECT_EQ(Job(job).tiles_done, 2);
    EXPECT_THAT(Job(job).header.error, HasSubstr("tile 0 was quarantined: '" + made + "' failed"));
  }
}

// A job that splits faces twice.
class SecondSplitTest : public TileQuarantineTest {
 protected:
  SecondSplitTest() {
    row_.steps = 4;
    row_.first_fine = 2;
  }
};

TEST_F(SecondSplitTest, TilesAreCutAgainAfterIt) {
  const std::string job = Create(AJob(3)), worker = Worker();
  double progress = 0;
  std::vector<std::string> order;
  while (const auto lease = Lease(worker)) {
    order.push_back(lease->plan.name);
    EXPECT_EQ(Job(job).tiles_done, 0) << "known once all tasks are planned";
    ASSERT_TRUE(SucceedAny(worker, *lease).ok());
    EXPECT_GE(Job(job).progress, progress) << "after " << lease->plan.name;
    progress = Job(job).progress;
    if (order.size() == 13) break;
    if (lease->plan.kind == kSplitKind) {
      EXPECT_LT(progress, 0.7);
    }
  }
  ASSERT_EQ(order.size(), 13u);
  EXPECT_EQ(order[1 + 3 + 2 * 3], "split");
  for (size_t i = 0; i < order.size(); ++i) EXPECT_EQ(order[i].ends_with("again"), i > 10) << order[i];
  Open();
  WorkAll({});
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
  EXPECT_EQ(Job(job).tiles_done, 3);
  EXPECT_EQ(Job(job).tiles_total, 3);
}

TEST_F(SecondSplitTest, OtherTilesContinueWithoutATileOfEitherPart) {
  for (const std::string bad : {"cut tile 1", "solve tile 1 step 1", "cut tile 1 again", "solve tile 1 step 3"}) {
    SCOPED_TRACE(bad);
    const std::string job = Create(AJob(4, bad));
    const std::map<std::string, int> runs = WorkAll({bad});
    EXPECT_EQ(Job(job).header.state, JobState::kPartial);
    EXPECT_EQ(Job(job).tiles_done, 3);
    EXPECT_EQ(runs.contains("cut tile 1 again"), bad.ends_with("again") || bad.ends_with("step 3"));
    EXPECT_FALSE(runs.contains("solve tile 1 step 3") && bad != "solve tile 1 step 3");
    EXPECT_EQ(runs.at("solve tile 3 step 3"), 1);
    EXPECT_EQ(runs.at("cut tile 3 again"), 1);
  }
}

TEST_F(SecondSplitTest, SameEndAfterReplayOfAnyPrefix) {
  const std::vector<std::string> bad = {"solve tile 1 step 1", "solve tile 2 step 2"};
  const std::string job = Create(AJob(4));
  WorkAll(bad);
  ASSERT_EQ(Job(job).header.state, JobState::kPartial);
  const std::string published = Published(job);
  coordinator_.reset();
  const std::vector<std::string> all = store_.records;
  for (size_t size = 1; size < all.size(); ++size) {
    coordinator_.reset();
    store_.records.assign(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(size));
    Open();
    clock_.Advance(31);
    ASSERT_TRUE(coordinator_->Tick().ok());
    clock_.Advance(10);
    WorkAll(bad);
    EXPECT_EQ(Job(job).header.state, JobState::kPartial) << "after " << size << " records";
    EXPECT_EQ(Published(job), published) << "after " << size << " records";
  }
}

// A tile of the coarse part is retried after the fine part ended: everything behind the first cuts is planned again.
TEST_F(SecondSplitTest, RetriedJobEndsLikeAnUndisturbedOne) {
  const std::string job = Create(AJob(4));
  WorkAll({"solve tile 0 step 1", "solve tile 3 step 3"});
  ASSERT_EQ(Job(job).header.state, JobState::kPartial);
  ASSERT_TRUE(coordinator_->jobs().RetryJob(job, 3).ok());
  std::map<std::string, int> runs = WorkAll({});
  EXPECT_EQ(Job(job).header.state, JobState::kPartial) << "tile 0 is quarantined";
  EXPECT_FALSE(runs.contains("split")) << "the tile failed behind it";
  ASSERT_TRUE(coordinator_->jobs().RetryJob(job, {}).ok());
  EXPECT_EQ(Job(job).tiles_done, 0) << "the fine part is not planned";
  Open();
  runs = WorkAll({});
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
  EXPECT_EQ(runs.at("split"), 1);
  EXPECT_EQ(runs.at("cut tile 0 again"), 1);
  EXPECT_EQ(Job(job).tiles_done, 4);
  const std::string published = Published(job);
  const std::string again = Create(AJob(4));
  EXPECT_TRUE(WorkAll({}).empty());
  EXPECT_EQ(Published(again), published);
}

// A retry of a tile of the coarse part plans the fine part anew, with the tiles that failed in it.
TEST_F(SecondSplitTest, RetryOfACoarseTileRetriesTilesOfTheFinePart) {
  for (const std::string fine : {"cut tile 1 again", "solve tile 1 step 2"}) {
    SCOPED_TRACE(fine);
    const std::string job = Create(AJob(4, fine));
    WorkAll({"solve tile 2 step 1", fine});
    ASSERT_EQ(Job(job).tiles_done, 2);
    ASSERT_TRUE(coordinator_->jobs().RetryJob(job, 2).ok());
    WorkAll({"split"});
    ASSERT_EQ(Job(job).header.state, JobState::kFailed) << Job(job).header.error;
    ASSERT_TRUE(coordinator_->jobs().RetryJob(job, {}).ok());
    Open();
    const std::map<std::string, int> runs = WorkAll({});
    EXPECT_EQ(Job(job).header.state, JobState::kSucceeded) << Job(job).header.error;
    EXPECT_EQ(runs.at("cut tile 1 again"), 1);
    EXPECT_EQ(Job(job).tiles_done, 4);
  }
}

TEST_F(SecondSplitTest, LostSurveyOfTheSplitIsMadeAgain) {
  const std::string job = Create(AJob(3)), worker = Worker();
  std::string survey;
  while (true) {
    const auto lease = Lease(worker);
    ASSERT_TRUE(lease);
    if (lease->plan.name == "solve tile 1 step 3") {
      const Digest digest = {Sha256Hex(survey), static_cast<int64_t>(survey.size())};
      ASSERT_TRUE(std::filesystem::remove(*blobs_->LocalPath(digest)));
      ASSERT_TRUE(Fail(worker, *lease, ErrorClass::kPoison).ok());
      break;
    }
    if (lease->plan.kind == kSplitKind) survey = kSurveyFile + lease->key;
    ASSERT_TRUE(SucceedAny(worker, *lease).ok());
  }
  clock_.Advance(10);
  const std::map<std::string, int> runs = WorkAll({"solve tile 1 step 3"});
  EXPECT_EQ(runs.at("split"), 1);
  EXPECT_EQ(Job(job).header.state, JobState::kPartial) << Job(job).header.error;
}

// The plan without the tile is then the one that the job has.
TEST_F(TileQuarantineTest, TileWhoseRetriedCutFailsAgainIsQuarantinedAgain) {
  const std::string job = Create(AJob(3));
  WorkAll({"cut tile 2"});
  ASSERT_EQ(Job(job).header.state, JobState::kPartial);
  ASSERT_TRUE(coordinator_->jobs().RetryJob(job, {}).ok());
  WorkAll({"cut tile 2"});
  EXPECT_EQ(Job(job).header.state, JobState::kPartial);
  Open();
  EXPECT_EQ(Job(job).tiles_done, 2);
}

TEST_F(TileQuarantineTest, RetryResetsAttempts) {
  const std::string job = Create(AJob(2)), worker = Worker();
  int attempt = 0;
  const auto fail = [&](int times) {
    for (int i = 0; i < times; ++i) {
      const auto lease = Lease(worker);
      ASSERT_TRUE(lease) << attempt;
      EXPECT_EQ(lease->attempt, ++attempt) << "late reports of earlier attempts are refused";
      ASSERT_TRUE(Fail(worker, *lease, ErrorClass::kInternal).ok());
      clock_.Advance(10);
    }
  };
  fail(4);
  ASSERT_EQ(Job(job).header.state, JobState::kFailed);
  EXPECT_EQ(coordinator_->jobs().RetryJob(job, 0).status().code(), absl::StatusCode::kFailedPrecondition);
  ASSERT_TRUE(coordinator_->jobs().RetryJob(job, {}).ok());
  fail(3);
  EXPECT_EQ(Job(job).header.state, JobState::kRunning) << "one more failure is allowed";
  WorkAll({});
  EXPECT_EQ(Job(job).header.state, JobState::kSucceeded);
  EXPECT_EQ(coordinator_->jobs().RetryJob(job, {}).status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST_F(TileQuarantineTest, QuarantineKeepsThePriority) {
  const std::string older = Create(AJob(2, "older")), job = Create(AJob(2)), worker = Worker();
  ASSERT_TRUE(coordinator_->jobs().ChangeJob(job, {5, {}}).ok());
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(SucceedAny(worker, *Lease(worker)).ok());  // the city and two cuts
  const auto lease = Lease(worker);
  ASSERT_TRUE(lease);
  ASSERT_EQ(lease->plan.kind, kSolveKind);
  for (int i = 0; i < 2; ++i) {
    const auto again = i == 0 ? lease : Lease(worker);
    ASSERT_TRUE(again);
    ASSERT_EQ(again->task, lease->task);
    ASSERT_TRUE(Fail(worker, *again, ErrorClass::kMemory).ok());
  }
  const auto next = Lease(worker);
  ASSERT_TRUE(next);
  EXPECT_EQ(next->task.substr(0, job.size()), job) << "not " << older;
}

}  // namespace
}  // namespace tessera
