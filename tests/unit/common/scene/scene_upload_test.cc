#include "common/scene/scene_upload.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <map>
#include <mutex>

#include "common/imaging/image_io.h"
#include "common/storage/files.h"
#include "tests/support/fake_clock.h"
#include "tests/support/scripted_http_server.h"

namespace tessera {
namespace {

using testing::HasSubstr;
using testing::UnorderedElementsAre;

// A store in memory below /bucket/city/.
class SceneUploadTest : public testing::Test {
 protected:
  SceneUploadTest() {
    S3ClientOptions options;
    options.retry.max_attempts = 2;
    options.sleeper = [](double) { return true; };
    client_ = S3Client::Create(ParseS3Url("s3://bucket/city", server_.url(), "").value(), credentials_.get(), &clock_,
                               options)
                  .value();
    Write("scene.json", R"({"tessera_scene": 1})");
    Write("mesh.ply", "ply");
    Write("truth/mesh.ply", "truth");
    Write(".cache/file", "left out");
    EXPECT_TRUE(EnsureFolder(folder_.path() + "/images").ok());
    EXPECT_TRUE(WriteJpeg(folder_.path() + "/images/a.jpg", ByteImage(8, 6, 3), 90).ok());
    EXPECT_TRUE(WriteJpeg(folder_.path() + "/images/by_content", ByteImage(8, 6, 3), 90).ok());
    Write("images/b.jpg", "no image");
    Write("images/empty.png", "");
  }
  void Write(const std::string& name, const std::string& content) {
    const std::string path = folder_.path() + "/" + name;
    EXPECT_TRUE(EnsureFolder(path.substr(0, path.rfind('/'))).ok());
    EXPECT_TRUE(WriteFileAtomic(path, content).ok());
  }
  ScriptedAnswer Answer(const ScriptedRequest& request) {
    const std::lock_guard lock(mutex_);
    ScriptedAnswer answer;
    if (request.target.starts_with("/bucket?")) {
      answer.body = "<ListBucketResult>";
      for (const auto& [name, object] : objects_) {
        answer.body += "<Contents><Key>city/" + name + "</Key><Size>" + std::to_string(object.first.size()) +
                       "</Size><ETag>e</ETag><LastModified>2013-05-24T00:00:00Z</LastModified></Contents>";
      }
      answer.body += "</ListBucketResult>";
      return answer;
    }
    const std::string name = request.target.substr(std::string("/bucket/city/").size());
    answer.headers = {{"ETag", "\"e\""}, {"Last-Modified", "Fri, 24 May 2013 00:00:00 GMT"}};
    if (request.method == "PUT") {
      if (name == refused_) {
        answer.status = 403;
        return answer;
      }
      puts_.push_back(name);
      const auto sha256 = request.headers.find("x-amz-meta-sha256");
      objects_[name] = {request.body, sha256 == request.headers.end() ? "" : sha256->second};
      return answer;
    }
    const auto object = objects_.find(name);
    if (object == objects_.end()) {
      answer.status = 404;
      return answer;
    }
    answer.body = object->second.first;
    answer.headers["Content-Length"] = std::to_string(answer.body.size());
    answer.headers["x-amz-meta-sha256"] = object->second.second;
    return answer;
  }
  std::vector<std::string> Puts() {
    const std::lock_guard lock(mutex_);
    return std::exchange(puts_, {});
  }

  std::mutex mutex_;
  std::map<std::string, std::pair<std::string, std::string>> objects_;  // content and its hash, by name
  std::vector<std::string> puts_;
  std::string refused_;
  TempFolder folder_ = TempFolder::Create("").value(), scratch_ = TempFolder::Create("").value();
  FakeClock clock_;
  std::unique_ptr<S3CredentialsSource> credentials_ = FixedS3Credentials({"A", "S", "", 0});
  ScriptedHttpServer server_{[this](const ScriptedRequest& request) { return Answer(request); }};
  std::unique_ptr<S3Client> client_;
};

TEST_F(SceneUploadTest, SendsAllFilesAndTheManifestLast) {
  const StatusOr<SceneUpload> upload = UploadScene(folder_.path(), *client_, {});
  ASSERT_TRUE(upload.ok()) << upload.status();
  EXPECT_EQ(upload->sent_files, 7);
  const std::vector<std::string> puts = Puts();
  EXPECT_THAT(puts, UnorderedElementsAre("scene.json", "mesh.ply", "truth/mesh.ply", "images/a.jpg", "images/b.jpg",
                                         "images/by_content", "images/empty.png", kManifestName));
  EXPECT_EQ(puts.back(), kManifestName);
  const StatusOr<SceneManifest> manifest = ParseManifest(objects_[kManifestName].first, kManifestName);
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  EXPECT_EQ(manifest->files.size(), 7u);
  EXPECT_EQ(FindFile(*manifest, "mesh.ply")->digest, (Digest{Sha256Hex("ply"), 3}));
  EXPECT_EQ(FindFile(*manifest, "images/a.jpg")->image->size, (ImageSize{8, 6}));
  EXPECT_THAT(std::string(FaultOf(*FindFile(*manifest, "images/b.jpg"), "").message()), HasSubstr("images/b.jpg: "));
}

TEST_F(SceneUploadTest, ARepeatedUploadSendsWhatIsMissingOrDiffers) {
  ASSERT_TRUE(UploadScene(folder_.path(), *client_, {}).ok());
  Puts();
  objects_.erase("mesh.ply");
  objects_["truth/mesh.ply"].second = Sha256Hex("other");
  Write("images/b.jpg", "NO IMAGE");  // of the same size
  const StatusOr<SceneUpload> upload = UploadScene(folder_.path(), *client_, {});
  ASSERT_TRUE(upload.ok()) << upload.status();
  EXPECT_EQ(upload->sent_files, 3);
  EXPECT_THAT(Puts(), UnorderedElementsAre("mesh.ply", "truth/mesh.ply", "images/b.jpg", kManifestName));
  EXPECT_EQ(objects_["images/b.jpg"].first, "NO IMAGE");
}

TEST_F(SceneUploadTest, WritesNoManifestAfterAnError) {
  refused_ = "mesh.ply";
  EXPECT_EQ(UploadScene(folder_.path(), *client_, {}).status().code(), absl::StatusCode::kPermissionDenied);
  EXPECT_FALSE(objects_.contains(kManifestName));
  TaskControl cancelled;
  cancelled.cancelled = [] { return true; };
  EXPECT_EQ(UploadScene(folder_.path(), *client_, cancelled).status().code(), absl::StatusCode::kCancelled);
}

TEST_F(SceneUploadTest, AFolderWithoutSceneJsonIsNoScene) {
  ASSERT_TRUE(RemoveTree(folder_.path() + "/scene.json").ok());
  EXPECT_EQ(UploadScene(folder_.path(), *client_, {}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(Puts().empty());
  EXPECT_EQ(DescribeStoredScene(*client_, scratch_.path(), {}).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(SceneUploadTest, DescribesAStoredSceneAsItsUploadDid) {
  ASSERT_TRUE(UploadScene(folder_.path(), *client_, {}).ok());
  const std::string manifest = objects_[kManifestName].first;
  objects_.erase(kManifestName);
  for (auto& [name, object] : objects_) object.second.clear();  // as other tools store them
  Puts();
  const StatusOr<SceneUpload> described = DescribeStoredScene(*client_, scratch_.path(), {});
  ASSERT_TRUE(described.ok()) << described.status();
  EXPECT_EQ(objects_[kManifestName].first, manifest);
  EXPECT_THAT(Puts(), UnorderedElementsAre(kManifestName));
  EXPECT_TRUE(ListFiles(scratch_.path())->empty());
}

}  // namespace
}  // namespace tessera
