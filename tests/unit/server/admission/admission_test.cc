#include "server/admission/admission.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/exporting/export_format.h"
#include "tests/unit/server/admission/admission_fixture.h"

namespace tessera {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class AdmissionTest : public AdmissionFixture {
 protected:
  AdmissionTest() {
    environment_.jobs = &coordinator_->jobs();
    environment_.limits = &limits_;
    environment_.digests = cache_.get();
    environment_.clock = &clock_;
    environment_.read_scene = [this](const std::string& path, const SceneRequest& request,
                                     const AllowedFiles&) -> StatusOr<SceneListing> {
      ++reads_;
      request_ = request;
      if (!FileExists(path + "/scene.json")) return absl::InvalidArgumentError("scene.json: missing");
      TESSERA_ASSIGN_OR_RETURN(auto files, ListFiles(path));
      SceneListing listing{path, "a scene", std::move(files), {"a warning"}};
      listing.classifier = request.classifier;
      listing.classifier_content = classifier_content_;
      return listing;
    };
  }
  Submission ASubmission(const std::string& request_id = "") const {
    Submission submission;
    submission.request_id = request_id;
    submission.scene_path = scene_;
    submission.settings.tiles = 2;
    submission.client = "client";
    return submission;
  }
  StatusOr<JobStatus> Submit(const Submission& submission, const Cancelled& cancelled = {}) {
    return Admission(environment_).Submit(submission, cancelled);
  }
  size_t JobCount() const { return coordinator_->jobs().ListJobs(-1, 100).size(); }

  ClientLimits limits_ = ClientLimits({}, blobs_.get());
  AdmissionEnvironment environment_;
  std::string classifier_content_;
  SceneRequest request_;
  int reads_ = 0;
};

TEST_F(AdmissionTest, SubmissionCreatesAJob) {
  Submission submission = ASubmission();
  submission.priority = 3;
  const auto job = Submit(submission);
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->header.name, "jobs/1");
  EXPECT_EQ(job->header.display_name, "a scene");
  EXPECT_EQ(job->header.scene_path, scene_);
  EXPECT_EQ(job->header.settings.tiles, 2);
  EXPECT_THAT(job->header.warnings, ElementsAre("a warning"));
  EXPECT_EQ(Job("jobs/1").header.priority, 3);
  EXPECT_TRUE(request_.needs_mesh);
  EXPECT_EQ(limits_.transfers(), 0) << "the transfer has ended";
  submission.display_name = "mine";
  EXPECT_EQ(Submit(submission)->header.display_name, "mine");
}

TEST_F(AdmissionTest, RepeatedSubmissionReturnsItsJobAndReadsNothing) {
  ASSERT_TRUE(Submit(ASubmission("id")).ok());
  Submission again = ASubmission("id");
  again.scene_path += "/./";
  EXPECT_EQ(Submit(again)->header.name, "jobs/1");
  EXPECT_EQ(reads_, 1);
  again.scene_path = "/other";
  const auto other = Submit(again);
  EXPECT_EQ(other.status().code(), absl::StatusCode::kAlreadyExists);
  EXPECT_THAT(std::string(other.status().message()), HasSubstr("scene_path: found /other, expected " + scene_));
  EXPECT_EQ(JobCount(), 1u);
}

TEST_F(AdmissionTest, ValidateCreatesNothing) {
  const auto job = Admission(environment_).Validate(ASubmission("id"));
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->header.name, "");
  EXPECT_EQ(job->header.display_name, "a scene");
  EXPECT_THAT(job->header.warnings, ElementsAre("a warning"));
  EXPECT_EQ(JobCount(), 0u);
  Submission missing = ASubmission();
  missing.scene_path = "/none";
  EXPECT_EQ(Admission(environment_).Validate(missing).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(AdmissionTest, AllOversizedFieldsAreReported) {
  Submission submission = ASubmission(std::string(257, 'r'));
  submission.display_name = std::string(257, 'd');
  submission.scene_path = "/" + std::string(4096, 's');
  submission.settings.update.base = std::string(70'000, 'b');
  const auto refused = Submit(submission);
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
  for (const char* field : {"request_id", "display_name", "scene_path", "settings"}) {
    EXPECT_THAT(std::string(refused.status().message()), HasSubstr(field));
  }
  EXPECT_EQ(reads_, 0);
}

TEST_F(AdmissionTest, InvalidSubmissionsAreRefusedBeforeTheSceneIsRead) {
  Submission relative = ASubmission();
  relative.scene_path = "relative";
  EXPECT_EQ(Submit(relative).status().code(), absl::StatusCode::kInvalidArgument);
  Submission urgent = ASubmission();
  urgent.priority = 1'000'000;
  EXPECT_EQ(Submit(urgent).status().code(), absl::StatusCode::kInvalidArgument);
  Submission no_base = ASubmission();
  no_base.settings.update.base = "jobs/7";
  EXPECT_EQ(Submit(no_base).status().code(), absl::StatusCode::kNotFound);
  environment_.scenes_over_network = false;
  EXPECT_EQ(Submit(ASubmission()).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(reads_, 0);
  Submission local = ASubmission();
  local.is_local = true;
  EXPECT_TRUE(Submit(local).ok());
}

TEST_F(AdmissionTest, ExportsOfAJobReadNoScene) {
  Submission submission = ASubmission();
  submission.scene_path.clear();
  submission.settings.update.base = "jobs/7";
  submission.settings.update.export_only = true;
  submission.settings.exports.formats = {"changes"};
  environment_.scenes_over_network = false;
  EXPECT_EQ(Submit(submission).status().code(), absl::StatusCode::kNotFound);
  submission.settings.exports.formats = {"changes", "paper"};
  const Status refused = Submit(submission).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument) << refused;
  EXPECT_THAT(std::string(refused.message()), HasSubstr("formats: found 'paper'"));
  EXPECT_EQ(reads_, 0);
}

// `--crs` for a scene without a coordinate reference system.
TEST_F(AdmissionTest, ExportsThatTheSceneCannotHaveAreRefused) {
  std::string format;
  for (const ExportFormat& each : ExportFormats()) {
    if (!each.reads_changes) format = each.name;
  }
  if (format.empty()) GTEST_SKIP() << "no format exports any result";
  Submission submission = ASubmission();
  submission.settings.exports.formats = {format};
  EXPECT_TRUE(Submit(submission).ok());
  submission.settings.exports.crs = "EPSG:32633";
  EXPECT_EQ(Submit(submission).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(AdmissionTest, ExportsWithoutAPlaceOnTheGlobeHaveAWarning) {
  Submission submission = ASubmission();
  submission.settings.exports.formats = {"3dtiles", "ply"};
  const auto job = Submit(submission);
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_THAT(job->header.warnings, ElementsAre("a warning", HasSubstr("3dtiles: the scene has no coordinate")));
}

TEST_F(AdmissionTest, LimitsAreCheckedBeforeTheSceneIsRead) {
  options_.limits.of_client = 1;
  Restart();
  environment_.jobs = &coordinator_->jobs();
  ASSERT_TRUE(Submit(ASubmission("id")).ok());
  EXPECT_EQ(Submit(ASubmission()).status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_TRUE(Submit(ASubmission("id")).ok()) << "the id has a job";
  Submission other = ASubmission();
  other.client = "other";
  ClientLimitOptions options;
  options.transfers = 1;
  ClientLimits limits(options, blobs_.get());
  environment_.limits = &limits;
  const auto transfer = limits.Transfer("other", {});
  EXPECT_EQ(Submit(other).status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(reads_, 1);
}

TEST_F(AdmissionTest, TrainedClassifierIsStoredWithTheJob) {
  classifier_content_ = "a model";
  Submission submission = ASubmission();
  submission.settings.classifier = "/model.json";
  ASSERT_TRUE(Submit(submission).ok());
  EXPECT_EQ(Job("jobs/1").header.settings.classifier, "/model.json");
  EXPECT_TRUE(blobs_->Has({Sha256Hex("a model"), 7}));
}

TEST_F(AdmissionTest, NameOfTheClassifierFileIsReserved) {
  WriteScene(kClassifierFile, "not one");
  const auto refused = Submit(ASubmission());
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(refused.status().message()), HasSubstr("it is reserved"));
}

TEST_F(AdmissionTest, CancelledSubmissionCreatesNoJob) {
  EXPECT_EQ(Submit(ASubmission(), [] { return true; }).status().code(), absl::StatusCode::kCancelled);
  environment_.read_scene = [](const std::string& path, const SceneRequest&, const AllowedFiles&) {
    return SceneListing{path, "no files to hash", {}, {}};
  };
  EXPECT_EQ(Submit(ASubmission(), [] { return true; }).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(JobCount(), 0u);
}

TEST_F(AdmissionTest, SceneInAStoreNeedsASceneRoot) {
  Submission submission = ASubmission();
  submission.scene_path = "s3://bucket/city";
  const Status refused = Submit(submission).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(refused.message()), HasSubstr("--scene-root s3://BUCKET/PREFIX"));
  EXPECT_EQ(reads_, 0);
}

TEST_F(AdmissionTest, CallerOverTheNetworkNamesNoFileOfTheMachine) {
  const StoredScenes none;
  environment_.stored_scenes = &none;
  environment_.scenes_over_network = false;
  Submission submission = ASubmission();
  submission.scene_path = "s3://bucket/city";
  submission.settings.classifier = scene_ + "/scene.json";
  EXPECT_THAT(std::string(Submit(submission).status().message()), HasSubstr("a classifier in a file cannot be"));
  submission.is_local = true;
  EXPECT_THAT(std::string(Submit(submission).status().message()), HasSubstr("in no --scene-root"));
  submission.is_local = false;
  submission.settings.classifier = kDefaultClassifier;
  EXPECT_THAT(std::string(Submit(submission).status().message()), HasSubstr("in no --scene-root"));
}

}  // namespace
}  // namespace tessera
