// What lists of tiles and images show of a job.
#include "server/tiles/tiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "tests/support/row_planner.h"
#include "tests/support/small_surveys.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;
using testing::StartsWith;

constexpr char kMesh[] = "mesh";

class TilesTest : public CoordinatorTest {
 protected:
  TilesTest() { Reopen(); }

  void Reopen() {
    tiles_.reset();
    coordinator_.reset();
    coordinator_ = *Coordinator::Open({&store_, blobs_.get(), &row_, &clock_, {}}, options_);
    tiles_.emplace(coordinator_->core(), coordinator_->planning());
  }
  // A job of `count` tiles with a survey.
  std::string CreateOnMap(int count) {
    survey_ = RandomSurvey(12, 9, 1, 7);
    row_.cores = Cores(survey_, count);
    return Create(AJob(count));
  }
  Status SucceedAny(const std::string& worker, const GrantedLease& lease, double confidence = 0) {
    if (lease.plan.kind == kIngestKind) {
      ReportedResult result;
      result.outputs = {{kSurveyFile, *blobs_->PutBytes(SurveyToJson(survey_))},
                        {kMesh, *blobs_->PutBytes("mesh of " + lease.key)}};
      return Settled(ReportSuccessAndWait(*coordinator_, worker, lease.task, lease.attempt, result));
    }
    if (lease.plan.kind != kSolveKind) return Succeed(worker, lease);
    ReportedResult result;
    result.usage = {2.5, 5 << 20, 1};
    result.stats = "{\"mean_confidence\":" + std::to_string(confidence) + "}";
    result.outputs.push_back({kStateFile, *blobs_->PutBytes("state " + lease.key)});
    return Settled(ReportSuccessAndWait(*coordinator_, worker, lease.task, lease.attempt, result));
  }
  // Leases and completes tasks until the next one is named `stop`, which is returned.
  std::optional<GrantedLease> WorkUntil(const std::string& worker, const std::string& stop, double confidence = 0) {
    while (auto lease = Lease(worker)) {
      if (lease->plan.name == stop) return lease;
      EXPECT_TRUE(SucceedAny(worker, *lease, confidence).ok());
    }
    return std::nullopt;
  }
  std::vector<ListedTile> List(const std::string& job) {
    const auto page = tiles_->ListTiles(job, 0, 1000);
    EXPECT_TRUE(page.ok()) << page.status();
    EXPECT_EQ(page->next, -1);
    return page.ok() ? page->tiles : std::vector<ListedTile>();
  }

  RowPlanner row_;
  Survey survey_;
  std::optional<Tiles> tiles_;
};

TEST_F(TilesTest, AJobWithoutAPlanHasNoTilesAndNoImages) {
  const std::string job = CreateOnMap(3);
  EXPECT_THAT(List(job), IsEmpty());
  const auto views = tiles_->ListViews(job, 0, 10);
  ASSERT_TRUE(views.ok()) << views.status();
  EXPECT_THAT(views->views, IsEmpty());
  EXPECT_EQ(tiles_->ListTiles("jobs/99", 0, 10).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(tiles_->ListViews("jobs/99", 0, 10).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(tiles_->ListTiles("nonsense", 0, 10).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(TilesTest, PlacesAreThoseOfTheSurvey) {
  const std::string job = CreateOnMap(3);
  const std::string worker = Worker();
  ASSERT_TRUE(WorkUntil(worker, "cut tile 0"));
  const std::vector<ListedTile> tiles = List(job);
  ASSERT_THAT(tiles, SizeIs(3));
  for (int t = 0; t < 3; ++t) {
    EXPECT_EQ(tiles[t].status.tile, t);
    const CellRect& core = row_.cores[t];
    EXPECT_THAT(tiles[t].place.core,
                ElementsAre(GroundRect{core.x0 * 8.0, core.y0 * 8.0, core.x1 * 8.0, core.y1 * 8.0}));
    std::set<int32_t> views;
    for (const SurveyCell& cell : survey_.cells) {
      if (core.Contains({cell.x, cell.y})) views.insert(cell.views.begin(), cell.views.end());
    }
    EXPECT_EQ(std::set<int32_t>(tiles[t].place.views.begin(), tiles[t].place.views.end()), views);
  }
  const auto views = tiles_->ListViews(job, 0, 1000);
  ASSERT_TRUE(views.ok());
  ASSERT_THAT(views->views, SizeIs(6));
  EXPECT_EQ(views->views[2].view.image, "images/2.jpg");
  EXPECT_NEAR(views->views[2].view.direction.norm(), 1, 1e-12);
}

TEST_F(TilesTest, RunningWaitingReadyAndDoneTilesDiffer) {
  const std::string job = CreateOnMap(3);
  const std::string first = Worker();
  const auto lease = WorkUntil(first, "solve tile 0 step 1");  // step 0 of all tiles has succeeded
  ASSERT_TRUE(lease);
  ASSERT_TRUE(coordinator_->leases().Heartbeat(first, {{lease->task, lease->attempt, 0.5, "moving"}}).ok());
  std::vector<ListedTile> tiles = List(job);
  EXPECT_EQ(tiles[0].status.state, TileProgress::kRunning);
  EXPECT_EQ(tiles[0].status.task, lease->task);
  EXPECT_EQ(tiles[0].status.title, "solve tile 0 step 1");
  EXPECT_EQ(tiles[0].status.worker, first);
  EXPECT_EQ(tiles[0].status.stage, "moving");
  EXPECT_EQ(tiles[0].status.tasks_total, 4);  // a cut and three solves
  EXPECT_EQ(tiles[0].status.tasks_done, 2);
  EXPECT_EQ(tiles[0].status.attempts, 3);
  EXPECT_EQ(tiles[0].status.failed_attempts, 0);
  EXPECT_EQ(tiles[0].status.core_seconds, 7.5 + 2.5);
  EXPECT_EQ(tiles[0].status.predicted_core_seconds, 4);
  EXPECT_EQ(tiles[0].status.peak_bytes, 5 << 20);
  EXPECT_NEAR(tiles[0].status.progress, 2.5 / 4, 1e-9);
  EXPECT_EQ(tiles[1].status.state, TileProgress::kReady);
  EXPECT_EQ(tiles[1].status.title, "solve tile 1 step 1");

  // Another worker completes what does not need tile 0: then tile 1 waits for it.
  const std::string second = Worker("other/boot");
  while (const auto other = LeaseAndWait(*coordinator_, second, 0, {}).value()) {
    ASSERT_TRUE(SucceedAny(second, *other).ok());
  }
  tiles = List(job);
  EXPECT_EQ(tiles[1].status.state, TileProgress::kWaiting);
  EXPECT_EQ(tiles[1].status.title, "solve tile 1 step 2");
  EXPECT_THAT(tiles[1].status.waits_for, ElementsAre(0));
  EXPECT_EQ(tiles[2].status.state, TileProgress::kDone);
  EXPECT_EQ(tiles[2].status.progress, 1);
  EXPECT_EQ(tiles[2].status.task, "");
  EXPECT_EQ(Job(job).stage,
            "solving step 1 of " + std::to_string(StepsOf(JobSettings()).size() - 1) + ", 2 of 3 tiles");
}

TEST_F(TilesTest, ErrorsAreToldNewestFirst) {
  const std::string job = CreateOnMap(2);
  const std::string worker = Worker();
  auto lease = WorkUntil(worker, "solve tile 0 step 0");
  ASSERT_TRUE(Fail(worker, *lease, ErrorClass::kInternal).ok());
  clock_.Advance(3600);  // past the delay of the retry
  ASSERT_TRUE(coordinator_->Tick().ok());
  const std::string other = Worker();  // the first one is forgotten
  lease = WorkUntil(other, "solve tile 0 step 0");
  ASSERT_TRUE(lease);
  ASSERT_TRUE(Settled(ReportFailureAndWait(*coordinator_, other, lease->task, lease->attempt,
                                           {ErrorClass::kTransient, std::string(5000, 'x') + "\n"}))
                  .ok());
  const std::vector<ListedTile> tiles = List(job);
  EXPECT_EQ(tiles[0].status.attempts, 3);  // of the cut too
  EXPECT_EQ(tiles[0].status.failed_attempts, 2);
  ASSERT_GE(tiles[0].status.reasons.size(), 2u);
  EXPECT_THAT(tiles[0].status.reasons[0],
              AllOf(StartsWith("attempt 2 on "), HasSubstr("xxx"), SizeIs(kMaxReasonBytes)));
  EXPECT_THAT(tiles[0].status.reasons[1],
              AllOf(HasSubstr("attempt 1 on " + worker), HasSubstr("(internal): it broke")));
  EXPECT_THAT(tiles[1].status.reasons, Not(Contains(HasSubstr("failed"))));
}

TEST_F(TilesTest, AQuarantinedTileNamesTheFailedTask) {
  const std::string job = CreateOnMap(3);
  const std::string worker = Worker();
  const auto lease = WorkUntil(worker, "solve tile 1 step 1");
  ASSERT_TRUE(Fail(worker, *lease, ErrorClass::kPoison).ok());
  std::vector<ListedTile> tiles = List(job);
  EXPECT_EQ(tiles[1].status.state, TileProgress::kQuarantined);
  EXPECT_EQ(tiles[1].status.title, "solve tile 1 step 1");
  EXPECT_EQ(tiles[1].status.failed_attempts, 1);
  EXPECT_THAT(tiles[1].status.reasons, ElementsAre(HasSubstr("(poison): it broke")));
  WorkUntil(worker, "");
  EXPECT_EQ(Job(job).header.state, JobState::kPartial);
  Reopen();  // the same from the records
  tiles = List(job);
  EXPECT_EQ(tiles[1].status.state, TileProgress::kQuarantined);
  EXPECT_EQ(tiles[1].status.failed_attempts, 1);
  EXPECT_THAT(tiles[1].status.reasons, ElementsAre(HasSubstr("(poison): it broke")));
  EXPECT_EQ(tiles[0].status.state, TileProgress::kDone);
}

TEST_F(TilesTest, AFailedJobHasAFailedTileAndCancelledOnes) {
  const std::string job = CreateOnMap(2);
  for (int attempt = 0; attempt < 2; ++attempt) {  // faults of the input are confirmed once
    const std::string worker = Worker();
    const auto lease = WorkUntil(worker, "solve tile 0 step 0");
    ASSERT_TRUE(lease);
    ASSERT_TRUE(Fail(worker, *lease, ErrorClass::kInput).ok());
    clock_.Advance(3600);
    ASSERT_TRUE(coordinator_->Tick().ok());
  }
  ASSERT_EQ(Job(job).header.state, JobState::kFailed);
  const std::vector<ListedTile> tiles = List(job);
  EXPECT_EQ(tiles[0].status.state, TileProgress::kFailed);
  EXPECT_THAT(tiles[0].status.reasons, Contains(HasSubstr("(input): it broke")));
  EXPECT_EQ(tiles[1].status.state, TileProgress::kCancelled);
}

TEST_F(TilesTest, ASecondJobReusesTheTilesOfTheFirst) {
  const std::string worker = Worker();
  CreateOnMap(2);
  WorkUntil(worker, "", 0.75);
  const std::string second = Create(AJob(2));
  WorkUntil(worker, "");
  const std::vector<ListedTile> tiles = List(second);
  ASSERT_THAT(tiles, SizeIs(2));
  EXPECT_EQ(tiles[0].status.state, TileProgress::kDone);
  EXPECT_EQ(tiles[0].status.tasks_reused, tiles[0].status.tasks_total);
  EXPECT_EQ(tiles[0].status.core_seconds, 0);
  EXPECT_EQ(tiles[0].status.attempts, 0);
  EXPECT_EQ(tiles[0].confidence, 0.75);
  EXPECT_EQ(Job(second).core_seconds, 0);
  EXPECT_GT(Job("jobs/1").core_seconds, 0);
}

TEST_F(TilesTest, PagesHoldEachTileOnce) {
  const std::string job = CreateOnMap(9);
  const std::string worker = Worker();
  WorkUntil(worker, "cut tile 0");
  std::vector<int> seen;
  int pages = 0;
  for (int next = 0; next >= 0; ++pages) {
    const auto page = tiles_->ListTiles(job, next, 4);
    ASSERT_TRUE(page.ok());
    EXPECT_LE(page->tiles.size(), 4u);
    for (const ListedTile& tile : page->tiles) seen.push_back(tile.status.tile);
    next = page->next;
  }
  EXPECT_EQ(pages, 3);
  EXPECT_THAT(seen, ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8));
  EXPECT_THAT(tiles_->ListTiles(job, 999'999'999, 4)->tiles, IsEmpty());
  std::vector<std::string> images;
  for (int next = 0; next >= 0;) {
    const auto page = tiles_->ListViews(job, next, 4);
    ASSERT_TRUE(page.ok());
    for (const ListedView& view : page->views) images.push_back(view.view.image);
    next = page->next;
  }
  EXPECT_EQ(images.size(), survey_.views.size());
}

TEST_F(TilesTest, APointIsOnTheTileThatOwnsItsGround) {
  const std::string job = CreateOnMap(3);
  EXPECT_EQ(tiles_->LocatePoint(job, {0, 0, 0}).status().code(), absl::StatusCode::kNotFound);  // no survey yet
  survey_.origin_in_scene = {100, 200, 300};
  ASSERT_TRUE(WorkUntil(Worker(), "cut tile 0"));
  for (const ListedTile& tile : List(job)) {
    const GroundRect& core = tile.place.core.at(0);
    const auto found = tiles_->LocatePoint(job, {core.x0_m + 1, core.y1_m - 1, 7});
    ASSERT_TRUE(found.ok()) << found.status();
    EXPECT_EQ(found->tile, tile.status.tile);
    EXPECT_EQ(found->point.in_scene, Eigen::Vector3d(core.x0_m + 101, core.y1_m + 199, 307));
    EXPECT_EQ(found->on_ground, Eigen::Vector2d(core.x0_m + 1, core.y1_m - 1));
    EXPECT_FALSE(found->point.geodetic);
  }
  EXPECT_EQ(tiles_->LocatePoint(job, {1e6, 0, 0})->tile, -1);
  EXPECT_EQ(tiles_->LocatePoint("jobs/9", {0, 0, 0}).status().code(), absl::StatusCode::kNotFound);
  // Without a place on the globe, cameras keep their coordinates but for the origin.
  const ListedView view = tiles_->ListViews(job, 2, 1)->views.at(0);
  EXPECT_LT((view.in_tiles + survey_.origin_in_scene - view.view.centre).norm(), 1e-9);
  EXPECT_LT((view.axis_in_tiles - view.view.direction).norm(), 1e-9);
}

TEST_F(TilesTest, WithoutItsSurveyAJobStillHasStates) {
  const std::string job = CreateOnMap(2);
  const std::string worker = Worker();
  ASSERT_TRUE(WorkUntil(worker, "cut tile 0"));
  Reopen();  // forgets the map
  const std::string content = SurveyToJson(survey_);
  int removed = 0;
  const std::vector<std::string> names = *ListFiles(blobs_->root());
  for (const std::string& name : names) {
    const std::string path = blobs_->root() + "/" + name;
    if (*ReadFile(path) != content) continue;
    ASSERT_TRUE(RemoveTree(path).ok());
    ++removed;
  }
  ASSERT_EQ(removed, 1);
  const std::vector<ListedTile> tiles = List(job);
  ASSERT_THAT(tiles, SizeIs(2));
  EXPECT_EQ(tiles[0].status.state, TileProgress::kRunning);
  EXPECT_THAT(tiles[0].place.core, IsEmpty());
  EXPECT_EQ(tiles_->ListViews(job, 0, 10).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace tessera
