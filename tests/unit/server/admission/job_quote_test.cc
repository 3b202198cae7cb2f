// The quote of a submission: from a stored survey, or rough, or none.
#include "server/admission/job_quote.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/meshio/ply.h"
#include "common/storage/files.h"
#include "server/admission/admission.h"
#include "server/jobs/planner.h"
#include "server/store/sqlite_store.h"
#include "server/tiling/quote.h"
#include "server/tiling/scene_survey.h"
#include "tests/support/fake_coordinator.h"
#include "tests/support/tiny_scene.h"

namespace tessera {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::StartsWith;

class JobQuoteTest : public CoordinatorTest {
 protected:
  JobQuoteTest() {
    coordinator_.reset();
    coordinator_ = *Coordinator::Open({&store_, blobs_.get(), &real_planner_, &clock_, {}}, options_);
    tiny_ = WriteTinyScene(scene_);
    EXPECT_TRUE(WritePly(scene_ + "/mesh.ply", tiny_.mesh).ok());
    environment_.jobs = &coordinator_->jobs();
    environment_.limits = &limits_;
    environment_.digests = cache_.get();
    environment_.clock = &clock_;
    environment_.blobs = blobs_.get();
    submission_.scene_path = scene_;
    submission_.client = "anna";
  }
  JobQuote Quote() {
    const auto quote = Admission(environment_).Quote(submission_);
    EXPECT_TRUE(quote.ok()) << quote.status();
    return quote.ok() ? *quote : JobQuote();
  }
  SceneDescription Scene() {
    Warnings warnings;
    return *LoadScene(scene_, &warnings);
  }

  Planner real_planner_;
  const std::string scene_ = FreshTestFolder("job_quote");
  TinyScene tiny_;
  std::unique_ptr<SqliteStore> cache_ = *SqliteStore::Open(folder_.path() + "/cache.sqlite");
  ClientLimits limits_ = ClientLimits({}, blobs_.get());
  AdmissionEnvironment environment_;
  Submission submission_;
};

TEST_F(JobQuoteTest, WithoutASurveyTheFiguresAreEstimates) {
  const JobQuote quote = Quote();
  EXPECT_EQ(quote.images, static_cast<int>(tiny_.cameras.size()));
  EXPECT_EQ(quote.pixels, 160.0 * 120.0 * static_cast<double>(tiny_.cameras.size()));
  EXPECT_EQ(quote.mesh_faces, static_cast<int64_t>(tiny_.mesh.faces.size()));
  EXPECT_EQ(quote.surveyed_by, "");
  ASSERT_TRUE(quote.core_seconds && quote.tiles && quote.area_m2);
  EXPECT_GT(quote.core_seconds->low, 0);
  EXPECT_GT(quote.core_seconds->high, quote.core_seconds->low);
  EXPECT_THAT(quote.estimated, Contains("core_seconds"));
  EXPECT_THAT(quote.estimated, Contains("tiles"));
  EXPECT_THAT(quote.basis, HasSubstr("faces of the start mesh"));
  EXPECT_THAT(coordinator_->jobs().ListJobs(-1, 10), IsEmpty());
  const auto exact = MakeQuote({}, EstimateSurvey(Scene(), tiny_.mesh, quote.gsd_m));
  ASSERT_TRUE(exact.ok());
  EXPECT_LE(quote.area_m2->low, exact->area_m2);
  EXPECT_GE(quote.area_m2->high, exact->area_m2);
  EXPECT_LE(quote.core_seconds->low, exact->core_seconds);
  EXPECT_GE(quote.core_seconds->high, exact->core_seconds);
}

TEST_F(JobQuoteTest, AStoredSurveyOfTheSameSceneGivesThePlan) {
  ASSERT_TRUE(Admission(environment_).Submit(submission_).ok());
  Survey survey = EstimateSurvey(Scene(), tiny_.mesh, 0.2);
  survey.flights = Scene().flights;
  FillViewDepths(&survey);
  const std::string worker = Worker();
  const auto ingest = Lease(worker);
  ASSERT_TRUE(ingest);
  ReportedResult result;
  for (const char* const name : {kSurveyFile, kPlainSurveyFile, kCityFile}) {
    result.outputs.push_back({name, *blobs_->PutBytes(SurveyToJson(survey))});
  }
  ASSERT_TRUE(Settled(ReportSuccessAndWait(*coordinator_, worker, ingest->task, ingest->attempt, result)).ok());

  submission_.settings.tiles = 4;  // the same survey serves other settings of the tiling
  const JobQuote quote = Quote();
  EXPECT_EQ(quote.surveyed_by, "jobs/1");
  const auto plan = MakeQuote(quote.settings, survey);
  ASSERT_TRUE(plan.ok());
  EXPECT_EQ(quote.tiles->low, static_cast<double>(plan->tiles.size()));
  EXPECT_EQ(quote.tiles->high, quote.tiles->low);
  EXPECT_EQ(quote.core_seconds->low, plan->interval.low * plan->core_seconds);
  EXPECT_EQ(quote.core_seconds->high, plan->interval.high * plan->core_seconds);
  EXPECT_EQ(quote.area_m2->low, plan->area_m2);
  EXPECT_THAT(quote.estimated, Not(Contains("tiles")));
  EXPECT_THAT(quote.basis, HasSubstr("jobs/1"));

  submission_.settings.max_core_seconds = 0.001;
  EXPECT_THAT(Quote().warnings, Contains(HasSubstr("more than the limit")));
  submission_.settings.max_core_seconds = 0;

  submission_.settings.method_settings.partners = 2;  // another survey
  EXPECT_EQ(Quote().surveyed_by, "");
  submission_.settings.method_settings = {};
  WriteText(scene_ + "/scene.json", ReadText(scene_ + "/scene.json") + "\n");  // another scene
  EXPECT_EQ(Quote().surveyed_by, "");
}

TEST_F(JobQuoteTest, AMeshThatCannotBeSampledGivesNoFigures) {
  WriteText(scene_ + "/mesh.ply", AsciiPly(tiny_.mesh, "double"));
  const JobQuote quote = Quote();
  EXPECT_EQ(quote.mesh_faces, static_cast<int64_t>(tiny_.mesh.faces.size()));
  EXPECT_FALSE(quote.tiles || quote.core_seconds || quote.peak_bytes || quote.stored_bytes || quote.area_m2);
  EXPECT_THAT(quote.estimated, IsEmpty());
  EXPECT_THAT(quote.basis, StartsWith("nothing"));
}

TEST_F(JobQuoteTest, FaultsAreThoseOfASubmission) {
  ASSERT_TRUE(RemoveTree(scene_ + "/images/" + tiny_.image_names[0]).ok());
  const Status refused = Admission(environment_).Validate(submission_).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(Admission(environment_).Quote(submission_).status(), refused);
  submission_.settings.tiles = -1;
  EXPECT_THAT(std::string(Admission(environment_).Quote(submission_).status().message()), HasSubstr("tiles: found -1"));
}

}  // namespace
}  // namespace tessera
