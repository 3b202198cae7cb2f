#include "server/http/routes.h"

#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <set>
#include <string>

#include "common/base/status.h"
#include "server/auth/access.h"
#include "server/http/transcoding.h"
#include "server/web/web_message.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/workers.pb.h"

namespace tessera {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(Routes, NameMethodsAndFieldsThatExist) {
  std::set<std::string> seen;
  ASSERT_NE(v1::ListJobsRequest::descriptor(), nullptr);
  ASSERT_NE(v1::ListWorkersRequest::descriptor(), nullptr);
  for (const Route& route : Routes()) {
    const std::string row = std::string(route.method) + " " + std::string(route.path);
    EXPECT_TRUE(seen.insert(row).second) << row << " is there twice";
    const bool open = route.kind == RouteKind::kPage || route.kind == RouteKind::kBeginSession ||
                      route.kind == RouteKind::kReadSession || route.kind == RouteKind::kEndSession;
    EXPECT_EQ(route.rpc.empty(), open) << row;
    if (open) continue;
    EXPECT_TRUE(RolesFor(std::string(route.rpc)).has_value()) << row;
    std::string name(route.rpc.substr(1));
    std::replace(name.begin(), name.end(), '/', '.');
    const auto* const method = google::protobuf::DescriptorPool::generated_pool()->FindMethodByName(name);
    ASSERT_NE(method, nullptr) << row;
    EXPECT_EQ(route.path.find("{job}") != std::string_view::npos, !route.job_field.empty()) << row;
    if (!route.job_field.empty()) {
      EXPECT_NE(method->input_type()->FindFieldByName(std::string(route.job_field)), nullptr) << row;
    }
    EXPECT_EQ(method->server_streaming(), route.kind == RouteKind::kWatch || route.kind == RouteKind::kState) << row;
    if (route.polled) {
      EXPECT_EQ(route.method, "GET") << row;
    }
  }
}

TEST(Routes, MatchWholePaths) {
  const auto job = FindRoute("GET", "/api/v1/jobs/12");
  ASSERT_NE(job.route, nullptr);
  EXPECT_EQ(job.route->rpc, "/tessera.v1.Jobs/GetJob");
  EXPECT_EQ(job.job, "jobs/12");
  EXPECT_EQ(FindRoute("HEAD", "/api/v1/jobs/12").route, job.route);
  EXPECT_EQ(FindRoute("POST", "/api/v1/jobs/3:cancel").route->rpc, "/tessera.v1.Jobs/CancelJob");
  const auto file = FindRoute("GET", "/files/jobs/7/export/3dtiles/result/tileset.json");
  ASSERT_NE(file.route, nullptr);
  EXPECT_EQ(file.job, "jobs/7");
  EXPECT_EQ(file.name, "export/3dtiles/result/tileset.json");
  for (const char* const path :
       {"/api/v1/jobs/", "/api/v1/jobs/x", "/api/v1/jobs/012", "/api/v1/jobs/0", "/api/v1/jobs/1/", "/api/v1/jobs/-1",
        "/api/v1/jobs/1:watch2", "/api/v1/jobs/1234567890", "/api/v1/job", "/files/jobs/7/", "/files/jobs/7",
        "/files/jobs/mesh.ply", "/assets/", "", "/index.html"}) {
    EXPECT_EQ(FindRoute("GET", path).route, nullptr) << path;
  }
  EXPECT_TRUE(FindRoute("PUT", "/api/v1/jobs").other_method);
  EXPECT_FALSE(FindRoute("PUT", "/api/v1/none").other_method);
}

TEST(DecodedPath, HasNoWayOut) {
  EXPECT_EQ(*DecodedPath("/files/jobs/1/a%20b%C3%A9.ply"), "/files/jobs/1/a b\xC3\xA9.ply");
  EXPECT_EQ(*DecodedPath("/"), "/");
  for (const char* const raw :
       {"/files/jobs/1/..", "/files/jobs/1/../2/mesh.ply", "/files/jobs/1/%2e%2e/2", "/files/jobs/1/.%2E/2",
        "/files/jobs/1/a%2fb", "/files/jobs/1/a%2Fb", "/files/jobs/1/a%5cb", "/files/jobs/1/a\\b",
        "/files/jobs/1/a%00.ply", "/files/jobs/1/%0a", "/files/jobs/1/./a", "/files//jobs/1/a", "/a%", "/a%2", "/a%zz",
        "", "files"}) {
    EXPECT_EQ(DecodedPath(raw).status().code(), absl::StatusCode::kNotFound) << raw;
  }
}

TEST(Transcoding, TakesBodyQueryAndPath) {
  v1::ListTasksRequest list;
  ASSERT_TRUE(list.ParseFromString(
      *RequestOf("/tessera.v1.Jobs/ListTasks", "", {{"pageSize", "7"}, {"pageToken", "x"}}, "parent", "jobs/3")));
  EXPECT_EQ(list.parent(), "jobs/3");
  EXPECT_EQ(list.page_size(), 7);
  EXPECT_EQ(list.page_token(), "x");
  v1::ChangeJobRequest change;
  ASSERT_TRUE(change.ParseFromString(
      *RequestOf("/tessera.v1.Jobs/ChangeJob", R"({"paused":true,"name":"jobs/9"})", {}, "name", "jobs/3")));
  EXPECT_TRUE(change.paused());
  EXPECT_FALSE(change.has_priority());
  EXPECT_EQ(change.name(), "jobs/3") << "the path decides";
  v1::CreateJobRequest create;
  ASSERT_TRUE(create.ParseFromString(*RequestOf(
      "/tessera.v1.Jobs/CreateJob", R"({"scenePath":"/s","settings":{"tiles":4,"tileMemoryBytes":"5000000000"}})",
      {{"validateOnly", "true"}}, "", "")));
  EXPECT_EQ(create.settings().tile_memory_bytes(), 5'000'000'000);
  EXPECT_TRUE(create.validate_only());
}

TEST(Transcoding, RefusesWhatItDoesNotKnow) {
  const auto refusal = [](const std::string& body, const HeaderList& params) {
    return RequestOf("/tessera.v1.Jobs/ListTasks", body, params, "parent", "jobs/1").status();
  };
  for (const char* const body :
       {"{", "[]", "7", "{\"parent\":7}", "{\"unknown\":1}", "{\"pageSize\":\"many\"}", "nonsense"}) {
    EXPECT_EQ(refusal(body, {}).code(), absl::StatusCode::kInvalidArgument) << body;
  }
  std::string deep;
  for (int i = 0; i < 100'000; ++i) deep += "{\"a\":";
  EXPECT_EQ(refusal(deep, {}).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(refusal("", {{"unknown", "1"}}).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(refusal("", {{"pageSize", "1"}, {"pageSize", "2"}}).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(refusal("", {{"pageSize", "1e99"}}).code(), absl::StatusCode::kInvalidArgument);
}

TEST(Transcoding, PrintsDefaultsEnumNamesAndLargeNumbers) {
  v1::Job job;
  job.set_name("jobs/1");
  job.set_display_name("<img src=x onerror=alert(1)>");
  job.set_state(v1::JOB_STATE_RUNNING);
  job.mutable_settings()->set_tile_memory_bytes(1);
  const std::string json = *JsonOf("/tessera.v1.Jobs/GetJob", job.SerializeAsString());
  EXPECT_THAT(json, HasSubstr(R"("state":"JOB_STATE_RUNNING")"));
  EXPECT_THAT(json, HasSubstr(R"("tileMemoryBytes":"1")"));
  EXPECT_THAT(json, HasSubstr(R"("paused":false)"));
  EXPECT_THAT(json, HasSubstr(R"("warnings":[])"));
  EXPECT_THAT(json, Not(HasSubstr("<img")));
}

}  // namespace
}  // namespace tessera
