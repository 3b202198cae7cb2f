// Published files over HTTP.
#include "common/storage/zip_writer.h"
#include "tests/unit/server/http/http_fixture.h"

namespace tessera {
namespace {

using testing::HasSubstr;

// A job that has published a mesh, a page, a large file, and tiles in the archive of a sheet.
class JobFilesTest : public HttpTest {
 protected:
  JobFilesTest() {
    const std::string in = folder_.path() + "/in";
    EXPECT_TRUE(EnsureFolder(in + "/result/3_-1").ok());
    EXPECT_TRUE(WriteFileAtomic(in + "/result/3_-1/0.glb", glb_).ok());
    EXPECT_TRUE(WriteFileAtomic(in + "/result/3_-1/tileset.json", "{\"of\":\"sheet\"}").ok());
    EXPECT_TRUE(
        WriteStoredZip(folder_.path() + "/sheet.zip", in, {"result/3_-1/0.glb", "result/3_-1/tileset.json"}).ok());
    files_ = {{"export/3dtiles/3_-1.zip", *ReadFile(folder_.path() + "/sheet.zip", 1 << 30)},
              {"export/3dtiles/result/tileset.json", "{\"of\":\"city\"}"},
              {"large", std::string(5 << 20, 'l') + "end"},
              {"report.html", "<script>alert(1)</script>"}};
    Publish();
    Create(AJob(1, "another scene"));  // jobs/2, without files
    viewer_ = Bearer("viewer");
  }
  void Publish() {
    Create(AJob(1));
    const std::string worker = Worker();
    while (auto lease = Lease(worker)) {
      ReportedResult result = Result(*lease);
      if (lease->plan.kind == "publish") {
        for (const auto& [name, content] : files_) result.outputs.push_back({name, *blobs_->PutBytes(content)});
      }
      EXPECT_TRUE(Settled(ReportSuccessAndWait(*coordinator_, worker, lease->task, lease->attempt, result)).ok());
    }
    EXPECT_EQ(Job("jobs/1").header.state, JobState::kSucceeded);
  }
  HttpReply Get(const std::string& target, const SentHeaders& more = {}, const std::string& method = "GET") {
    SentHeaders headers = viewer_;
    headers.insert(headers.end(), more.begin(), more.end());
    return Ask(method, target, headers);
  }

  const std::string glb_ = std::string(3 << 20, 'g') + "end of the tile";
  std::map<std::string, std::string> files_;
  SentHeaders viewer_;
};

TEST_F(JobFilesTest, AreWholeOrPartsByName) {
  const HttpReply whole = Get("/files/jobs/1/large");
  EXPECT_EQ(whole.status, 200);
  EXPECT_EQ(whole.body, files_["large"]);
  EXPECT_EQ(whole.Header("content-type"), "application/octet-stream");
  EXPECT_EQ(whole.Header("accept-ranges"), "bytes");
  EXPECT_EQ(whole.Header("etag"), "\"" + Sha256Hex(files_["large"]) + "\"");
  const std::string size = std::to_string(files_["large"].size());
  const HttpReply part = Get("/files/jobs/1/large", {{"Range", "bytes=5242878-5242881"}});
  EXPECT_EQ(part.status, 206);
  EXPECT_EQ(part.body, "llen");
  EXPECT_EQ(part.Header("content-range"), "bytes 5242878-5242881/" + size);
  EXPECT_EQ(Get("/files/jobs/1/large", {{"Range", "bytes=-3"}}).body, "end");
  const HttpReply outside = Get("/files/jobs/1/large", {{"Range", "bytes=5242883-"}});
  EXPECT_EQ(outside.status, 416);
  EXPECT_EQ(outside.Header("content-range"), "bytes */" + size);
  EXPECT_EQ(Get("/files/jobs/1/large", {{"Range", "bytes=-3"}, {"If-Range", "\"another\""}}).status, 200);
  EXPECT_EQ(Get("/files/jobs/1/large", {{"Range", "bytes=-3"}, {"If-Range", whole.Header("etag")}}).status, 206);
  EXPECT_EQ(Get("/files/jobs/1/large", {{"Range", "bytes=0-1,3-4,6-7"}}).status, 200) << "one part or all";
  const HttpReply known = Get("/files/jobs/1/large", {{"If-None-Match", whole.Header("etag")}});
  EXPECT_EQ(known.status, 304);
  const HttpReply head = Get("/files/jobs/1/large", {}, "HEAD");
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.Header("content-length"), size);
}

TEST_F(JobFilesTest, InsideArchivesOfSheetsHaveTheirFetchedNames) {
  EXPECT_EQ(Get("/files/jobs/1/export/3dtiles/result/tileset.json").body, files_["export/3dtiles/result/tileset.json"]);
  const HttpReply tileset = Get("/files/jobs/1/export/3dtiles/result/3_-1/tileset.json");
  EXPECT_EQ(tileset.status, 200);
  EXPECT_EQ(tileset.body, "{\"of\":\"sheet\"}");
  EXPECT_EQ(tileset.Header("content-type"), "application/json");
  const HttpReply tile = Get("/files/jobs/1/export/3dtiles/result/3_-1/0.glb");
  EXPECT_EQ(tile.body, glb_);
  EXPECT_EQ(tile.Header("content-type"), "model/gltf-binary");
  EXPECT_NE(tile.Header("etag"), tileset.Header("etag"));
  EXPECT_EQ(Get("/files/jobs/1/export/3dtiles/result/3_-1/0.glb", {{"Range", "bytes=-4"}}).body, "tile");
  EXPECT_EQ(Get("/files/jobs/1/export/3dtiles/result/3_-1/0.glb", {{"If-None-Match", tile.Header("etag")}}).status,
            304);
  EXPECT_EQ(Get("/files/jobs/1/export/3dtiles/3_-1.zip").body, files_["export/3dtiles/3_-1.zip"]);
  for (const char* const name :
       {"result/3_-1/1.glb", "result/3_-2/0.glb", "start/3_-1/0.glb", "3_-1/0.glb", "result/"}) {
    EXPECT_EQ(Get("/files/jobs/1/export/3dtiles/" + std::string(name)).status, 404) << name;
  }
}

TEST_F(JobFilesTest, PagesOfAJobHaveNoRights) {
  const HttpReply page = Get("/files/jobs/1/report.html");
  EXPECT_EQ(page.status, 200);
  EXPECT_THAT(page.Header("content-security-policy"), HasSubstr("sandbox"));
  EXPECT_EQ(page.headers.count("content-security-policy"), 1u);
  EXPECT_EQ(page.Header("x-content-type-options"), "nosniff");
}

TEST_F(JobFilesTest, NoPathLeadsOutOfTheResult) {
  for (const char* const target :
       {"/files/jobs/2/mesh.ply", "/files/jobs/2/../1/mesh.ply", "/files/jobs/1/../../../etc/passwd",
        "/files/jobs/1/%2e%2e/%2e%2e/etc/passwd", "/files/jobs/1/..%2f..%2fetc%2fpasswd", "/files/jobs/1/..\\..\\etc",
        "/files/jobs/1/mesh.ply%00.html", "/files/jobs/1//mesh.ply", "/files/jobs/1/./mesh.ply",
        "/files/jobs/1/mesh.pl", "/files/jobs/1/mesh.ply/", "/files/jobs/1/export%2F3dtiles%2Fresult%2Ftileset.json",
        "/files/jobs/1/export/3dtiles/../../mesh.ply", "/files/jobs/01/mesh.ply", "/files/jobs/1:x/mesh.ply",
        "/files/../api/v1/jobs", "/files/jobs/99/mesh.ply"}) {
    EXPECT_EQ(Get(target).status, 404) << target;
  }
  EXPECT_EQ(Get("/files/jobs/1/mesh.ply").status, 200);
  EXPECT_EQ(Ask("GET", "/files/jobs/1/mesh.ply", Bearer("worker")).status, 403);
}

TEST_F(JobFilesTest, ALostBlobIsAnErrorBeforeTheAnswerBegins) {
  std::filesystem::remove(*blobs_->LocalPath(DigestOf(files_["large"])));
  coordinator_->core().Stop();  // nothing is recomputed
  EXPECT_EQ(Get("/files/jobs/1/large").status, 503);
}

}  // namespace
}  // namespace tessera
