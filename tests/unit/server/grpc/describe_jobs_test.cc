// The calls that describe jobs to pages: tiles, files, settings, quotes.
#include <gmock/gmock.h>

#include <set>

#include "common/rpc/status_conversion.h"
#include "tests/unit/server/grpc/server_fixture.h"

namespace tessera {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

class DescribeJobsTest : public ServerTest {
 protected:
  template <class Request, class Response>
  Status Ask(grpc::Status (v1::Jobs::Stub::*method)(grpc::ClientContext*, const Request&, Response*),
             const Request& request, Response* response) {
    grpc::ClientContext context;
    return FromGrpc((jobs_.get()->*method)(&context, request, response));
  }
  // A job of 2 tiles that has published `files` files below tiles/, mesh.ply first.
  std::string Published(int files) {
    v1::Job job;
    EXPECT_TRUE(CreateJob(&job).ok());
    const std::string worker = Worker();
    const Digest content = *blobs_->PutBytes("a tile");
    while (const auto lease = Lease(worker)) {
      ReportedResult result = Result(*lease);
      for (int i = 0; lease->plan.kind == kPublishKind && i < files; ++i) {
        result.outputs.push_back({"tiles/" + std::to_string(i) + ".ply", content});
      }
      EXPECT_TRUE(Settled(ReportSuccessAndWait(*coordinator_, worker, lease->task, lease->attempt, result)).ok());
    }
    return job.name();
  }
};

TEST_F(DescribeJobsTest, AJobHasItsFirstThousandFilesAndPagesHaveAll) {
  const std::string name = Published(2345);
  v1::GetJobRequest get;
  get.set_name(name);
  v1::Job job;
  ASSERT_TRUE(Ask(&v1::Jobs::Stub::GetJob, get, &job).ok());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED);
  EXPECT_EQ(job.artifacts_size(), 1000);
  EXPECT_EQ(job.artifacts_total(), 2347);  // with mesh.ply and job.json
  v1::ListJobsResponse list;
  ASSERT_TRUE(Ask(&v1::Jobs::Stub::ListJobs, {}, &list).ok());
  EXPECT_EQ(list.jobs(0).artifacts_size(), 0);  // a list is short
  EXPECT_EQ(list.jobs(0).artifacts_total(), 2347);
  std::set<std::string> names;
  v1::ListArtifactsRequest request;
  request.set_parent(name);
  int pages = 0;
  do {
    v1::ListArtifactsResponse page;
    ASSERT_TRUE(Ask(&v1::Jobs::Stub::ListArtifacts, request, &page).ok());
    EXPECT_LE(page.artifacts_size(), 1000);
    if (pages++ == 0) {
      EXPECT_EQ(page.artifacts(7).SerializeAsString(), job.artifacts(7).SerializeAsString());
    }
    for (const v1::Artifact& each : page.artifacts()) EXPECT_TRUE(names.insert(each.name()).second) << each.name();
    request.set_page_token(page.next_page_token());
  } while (!request.page_token().empty());
  EXPECT_EQ(names.size(), 2347u);
  EXPECT_EQ(pages, 3);
  EXPECT_TRUE(names.contains("job.json"));
  request.set_name_prefix("tiles/12");
  v1::ListArtifactsResponse some;
  ASSERT_TRUE(Ask(&v1::Jobs::Stub::ListArtifacts, request, &some).ok());
  EXPECT_EQ(some.artifacts_size(), 1 + 10 + 100);  // 12, 12x, 12xx
  EXPECT_EQ(some.next_page_token(), "");
}

TEST_F(DescribeJobsTest, ARunningJobHasNoFilesAndUnknownOnesAreNotFound) {
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job).ok());
  v1::ListArtifactsRequest request;
  request.set_parent(job.name());
  v1::ListArtifactsResponse page;
  ASSERT_TRUE(Ask(&v1::Jobs::Stub::ListArtifacts, request, &page).ok());
  EXPECT_EQ(page.artifacts_size(), 0);
  EXPECT_EQ(page.next_page_token(), "");
  request.set_page_token("12x");
  EXPECT_THAT(std::string(Ask(&v1::Jobs::Stub::ListArtifacts, request, &page).message()), HasSubstr("page token"));
  request.clear_page_token();
  request.set_parent("jobs/77");
  EXPECT_EQ(Ask(&v1::Jobs::Stub::ListArtifacts, request, &page).code(), absl::StatusCode::kNotFound);
  v1::ListTilesRequest tiles;
  tiles.set_parent("jobs/77");
  v1::ListTilesResponse listed;
  EXPECT_EQ(Ask(&v1::Jobs::Stub::ListTiles, tiles, &listed).code(), absl::StatusCode::kNotFound);
  tiles.set_parent(job.name());
  tiles.set_page_token("-1");
  EXPECT_EQ(Ask(&v1::Jobs::Stub::ListTiles, tiles, &listed).code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(DescribeJobsTest, TilesComeInPagesWithTheirNumbers) {
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job).ok());
  const std::string worker = Worker();
  const auto ingest = Lease(worker);
  ASSERT_TRUE(Succeed(worker, *ingest).ok());
  const auto refine = Lease(worker);  // the dearest first
  ASSERT_EQ(refine->plan.tile, 1);
  v1::ListTilesRequest request;
  request.set_parent(job.name());
  request.set_page_size(1);
  v1::ListTilesResponse first, second;
  ASSERT_TRUE(Ask(&v1::Jobs::Stub::ListTiles, request, &first).ok());
  ASSERT_EQ(first.tiles_size(), 1);
  EXPECT_EQ(first.tiles(0).tile(), 0);
  EXPECT_EQ(first.tiles(0).state(), v1::TILE_STATE_READY);
  EXPECT_EQ(first.tiles(0).predicted_core_seconds(), 1);
  request.set_page_token(first.next_page_token());
  ASSERT_TRUE(Ask(&v1::Jobs::Stub::ListTiles, request, &second).ok());
  ASSERT_EQ(second.tiles_size(), 1);
  EXPECT_EQ(second.tiles(0).tile(), 1);
  EXPECT_EQ(second.tiles(0).state(), v1::TILE_STATE_RUNNING);
  EXPECT_EQ(second.tiles(0).worker(), worker);
  EXPECT_EQ(second.tiles(0).task(), refine->task);
  EXPECT_EQ(second.tiles(0).title(), "refine tile 1");
  EXPECT_EQ(second.tiles(0).tasks_total(), 1);
  EXPECT_EQ(second.next_page_token(), "");
}

TEST_F(DescribeJobsTest, AJobSaysWhatItDoesAndWhatItCosts) {
  v1::Job job;
  ASSERT_TRUE(CreateJob(&job).ok());
  const std::string worker = Worker();
  const auto ingest = Lease(worker);
  v1::GetJobRequest get;
  get.set_name(job.name());
  ASSERT_TRUE(Ask(&v1::Jobs::Stub::GetJob, get, &job).ok());
  EXPECT_EQ(job.stage(), "reading the scene");
  EXPECT_EQ(job.core_seconds(), 0);
  EXPECT_EQ(job.predicted_core_seconds(), 1);
  EXPECT_EQ(job.owner(), "") << "the caller has no token";
  EXPECT_LT(job.eta_low_s(), 0);
  ASSERT_TRUE(Succeed(worker, *ingest).ok());
  clock_.Advance(10);
  auto refine = Lease(worker);
  clock_.Advance(10);
  ASSERT_TRUE(Succeed(worker, *refine).ok());
  refine = Lease(worker);
  ASSERT_TRUE(Ask(&v1::Jobs::Stub::GetJob, get, &job).ok());
  EXPECT_EQ(job.stage(), "refining, 1 of 2 tiles");
  EXPECT_EQ(job.core_seconds(), 15);
  EXPECT_EQ(job.predicted_core_seconds(), 1 + 1 + 2 + 1);
  EXPECT_GT(job.eta_low_s(), 0);
  EXPECT_LT(job.eta_low_s(), job.eta_s());
  EXPECT_GT(job.eta_high_s(), job.eta_s());
  ASSERT_TRUE(Succeed(worker, *refine).ok());
  EXPECT_EQ(WorkAll(worker), 1);
  ASSERT_TRUE(Ask(&v1::Jobs::Stub::GetJob, get, &job).ok());
  EXPECT_EQ(job.stage(), "");
  EXPECT_EQ(job.core_seconds(), 30);
  EXPECT_EQ(job.eta_high_s(), 0);
}

TEST_F(DescribeJobsTest, SettingsHaveHelpAndPlaces) {
  v1::ListSettingsResponse settings;
  ASSERT_TRUE(Ask(&v1::Jobs::Stub::ListSettings, v1::ListSettingsRequest(), &settings).ok());
  std::set<std::string> names;
  for (const v1::Setting& setting : settings.settings()) {
    EXPECT_TRUE(names.insert(setting.name()).second) << setting.name();
    EXPECT_NE(setting.help(), "") << setting.name();
    EXPECT_NE(setting.kind(), v1::SETTING_KIND_UNSPECIFIED) << setting.name();
    EXPECT_TRUE(v1::SettingKind_IsValid(setting.kind())) << setting.name();
    const bool chooses = setting.kind() == v1::SETTING_KIND_CHOICE || setting.kind() == v1::SETTING_KIND_CHOICES;
    EXPECT_EQ(setting.choices_size() > 0, chooses) << setting.name();
  }
  EXPECT_TRUE(names.contains("thin_plate"));
  ASSERT_EQ(settings.methods_size(), 4);
  EXPECT_EQ(settings.methods(0).name(), "tessera");
  EXPECT_NE(settings.methods(3).help(), "");
  EXPECT_GT(settings.formats_size(), 3);
}

TEST_F(DescribeJobsTest, AQuoteCreatesNothingAndRefusesWhatASubmissionWould) {
  v1::CreateJobRequest request;
  request.set_scene_path(scene_);
  request.mutable_settings()->set_tiles(2);
  v1::Quote quote;
  ASSERT_TRUE(Ask(&v1::Jobs::Stub::QuoteJob, request, &quote).ok());
  EXPECT_EQ(quote.settings().tiles(), 2);
  EXPECT_THAT(quote.warnings(), testing::Contains("an odd thing"));
  EXPECT_EQ(quote.mesh_faces(), -1);
  EXPECT_FALSE(quote.has_core_seconds()) << "the fake scene has no mesh";
  EXPECT_THAT(quote.basis(), StartsWith("nothing"));
  EXPECT_THAT(coordinator_->jobs().ListJobs(-1, 10), IsEmpty());

  request.mutable_settings()->set_tiles(-1);
  request.mutable_settings()->mutable_method_settings()->set_partners(99);
  const Status faults = Ask(&v1::Jobs::Stub::QuoteJob, request, &quote);
  EXPECT_EQ(faults.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(faults.message()), AllOf(HasSubstr("tiles: found -1"), HasSubstr("partners: found 99")));
  request.set_scene_path(folder_.path() + "/absent");
  request.clear_settings();
  EXPECT_THAT(std::string(Ask(&v1::Jobs::Stub::QuoteJob, request, &quote).message()), HasSubstr("scene.json: missing"));
}

}  // namespace
}  // namespace tessera
