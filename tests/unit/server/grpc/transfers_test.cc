// Workers and clients transfer blobs directly to and from a real S3 store; no byte passes the coordinator.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <memory>
#include <string>

#include "common/scene/stored_scenes.h"
#include "tests/support/servers/test_s3.h"
#include "tests/unit/server/grpc/server_fixture.h"

namespace tessera {
namespace {

class TransfersTest : public ServerTest {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("radosgw");
    s3_ = std::make_unique<TestS3>();
    remote_ = *S3Blobs::Open(s3_->client.get(), &s3_->clock, folder_.path() + "/staging", 3600);
    local_ = *FolderBlobs::Open(folder_.path() + "/local");
    OpenTransfers({});
    v1::Job job;
    ASSERT_TRUE(CreateJob(&job).ok());
    worker_ = Register().worker();
  }
  ~TransfersTest() override { server_.reset(); }

  // Restarts the server.
  void OpenTransfers(const BlobTransferOptions& options, std::optional<SignedHash> hash = SignedHash::kContent) {
    transfers_ = std::make_unique<BlobTransfers>(s3_->client.get(), remote_.get(), hash, options);
    environment_.transfers = transfers_.get();
    environment_.blobs = remote_.get();
    RestartServer();
  }
  Status Send(const std::string& content, const Digest& digest) {
    const std::string path = folder_.path() + "/upload";
    std::ofstream(path, std::ios::binary) << content;
    RetryPolicy retry;
    retry.max_attempts = 2;
    return BlobClient(ChannelOf(worker_), retry, [](double) { return true; }).Send(path, digest, {});
  }
  Status Send(const std::string& content) { return Send(content, DigestOf(content)); }
  // Bytes that passed the coordinator.
  int64_t Passed() const {
    return server_->rpc_counts().blob_bytes_read() + server_->rpc_counts().blob_bytes_written();
  }
  // An input of a lease of the worker, with its content in the store.
  Digest LeasedInput() {
    const auto ingest = Lease(worker_);
    EXPECT_TRUE(Succeed(worker_, *ingest).ok());
    const auto lease = Lease(worker_);
    for (const auto& input : lease->inputs) {
      const auto content = blobs_->Read(input.file.digest);
      if (!content.ok()) continue;  // a file of the scene
      EXPECT_TRUE(remote_->PutBytes(*content).ok());
      return input.file.digest;
    }
    ADD_FAILURE() << "no input is a blob";
    return {};
  }

  std::unique_ptr<TestS3> s3_;
  std::unique_ptr<S3Blobs> remote_;
  std::unique_ptr<FolderBlobs> local_;
  std::unique_ptr<BlobTransfers> transfers_;
  std::string worker_;
};

TEST_F(TransfersTest, WorkerStoresAndReadsWithoutTheCoordinator) {
  const Digest input = LeasedInput();
  const std::string content = std::string(3'000'000, 'r') + "end";
  ASSERT_TRUE(Send(content).ok());
  EXPECT_EQ(*remote_->Read(DigestOf(content)), content);
  ASSERT_TRUE(Send(content).ok()) << "it is stored";
  ASSERT_TRUE(Send("").ok());
  const Status fetched = Fetch(input, *local_, worker_);
  ASSERT_TRUE(fetched.ok()) << fetched;
  EXPECT_TRUE(local_->Verify(input).ok());
  EXPECT_EQ(Passed(), 0);
}

TEST_F(TransfersTest, UrlsPreparedForSeveralBlobsAreUsed) {
  const Digest input = LeasedInput();
  BlobClient client(ChannelOf(worker_), {}, [](double) { return true; });
  client.Prepare({input});
  const auto calls = [&] {
    int64_t sum = 0;
    for (const auto& method : server_->rpc_counts().methods()) {
      if (method->name == "Blobs/GetTransfers") sum += method->codes[0];
    }
    return sum;
  };
  EXPECT_EQ(calls(), 1);
  ASSERT_TRUE(client.Fetch(input, *local_, {}).ok());
  EXPECT_EQ(calls(), 1);
}

TEST_F(TransfersTest, FileThatDoesNotHashToItsDigestIsRefused) {
  LeasedInput();
  const Digest digest = DigestOf("content");
  EXPECT_FALSE(Send("CONTENT", digest).ok());
  EXPECT_FALSE(remote_->Has(digest));
}

TEST_F(TransfersTest, DamagedBlobIsFoundAndQuarantined) {
  const Digest input = LeasedInput();
  const std::string damaged(static_cast<size_t>(input.size_bytes), '?');
  ASSERT_TRUE(s3_->client->Put(S3Blobs::KeyOf(input), damaged, Sha256Hex(damaged)).ok());
  const Status fetched = Fetch(input, *local_, worker_);
  EXPECT_EQ(fetched.code(), absl::StatusCode::kNotFound) << fetched;
  EXPECT_FALSE(local_->Has(input));
  EXPECT_FALSE(remote_->Has(input));
  EXPECT_EQ(remote_->List(BlobStore::kParts - 1)->size(), 1u);
}

TEST_F(TransfersTest, InterruptedFetchResumes) {
  const Digest input = LeasedInput();
  const std::string content = *remote_->Read(input);
  ASSERT_TRUE(local_->Append(input, 0, content.substr(0, content.size() / 2)).ok());
  const int64_t before = s3_->client->counts()["get"].received_bytes;
  ASSERT_TRUE(Fetch(input, *local_, worker_).ok());
  EXPECT_EQ(*local_->Read(input), content);
  EXPECT_EQ(s3_->client->counts()["get"].received_bytes, before) << "the coordinator's client read it";
}

TEST_F(TransfersTest, FilesOfTheScenePassTheBlobService) {
  ASSERT_TRUE(LeaseOverRpc(worker_).has_lease());
  const Digest image = *HashFile(scene_ + "/image");
  const Status fetched = Fetch(image, *local_, worker_);
  ASSERT_TRUE(fetched.ok()) << fetched;
  EXPECT_EQ(Passed(), image.size_bytes);
}

TEST_F(TransfersTest, LargeContentIsSentInParts) {
  OpenTransfers({.max_put_bytes = 6 << 20, .min_part_bytes = 5 << 20});
  worker_ = Register().worker();
  LeasedInput();
  const std::string content = std::string(5 << 20, 'a') + std::string(5 << 20, 'b') + "end";
  const Status sent = Send(content);
  ASSERT_TRUE(sent.ok()) << sent;
  EXPECT_TRUE(remote_->Verify(DigestOf(content)).ok());
  EXPECT_TRUE(remote_->List(BlobStore::kParts - 2)->empty()) << "no upload is left";
  EXPECT_EQ(Passed(), 0);
}

TEST_F(TransfersTest, UploadsPassTheCoordinatorIfTheStoreTakesNone) {
  OpenTransfers({}, std::nullopt);
  worker_ = Register().worker();
  LeasedInput();
  ASSERT_TRUE(Send("content").ok());
  EXPECT_TRUE(remote_->Verify(DigestOf("content")).ok());
  EXPECT_EQ(Passed(), 7);
}

TEST_F(TransfersTest, OutageOfTheStoreIsToldWithItsReason) {
  const Digest input = LeasedInput();
  S3Location nowhere = s3_->location;
  nowhere.endpoint = "http://127.0.0.1:1";
  const TestS3 other({}, nowhere);
  const BlobTransfers broken(other.client.get(), remote_.get(), SignedHash::kContent);
  environment_.transfers = &broken;
  RestartServer();
  worker_ = Register().worker();
  ASSERT_TRUE(Lease(worker_).has_value());
  std::string reason;
  TaskControl control;
  control.report = [&](double, const std::string& stage) { reason = stage.empty() ? reason : stage; };
  RetryPolicy retry;
  retry.max_attempts = 3;
  const std::string path = folder_.path() + "/upload";
  std::ofstream(path) << "content";
  const Status sent =
      BlobClient(ChannelOf(worker_), retry, [](double) { return true; }).Send(path, DigestOf("content"), control);
  EXPECT_EQ(sent.code(), absl::StatusCode::kUnavailable) << sent;
  EXPECT_THAT(reason, testing::HasSubstr("127.0.0.1"));
  EXPECT_THAT(std::string(sent.message()), testing::Not(testing::HasSubstr("Signature")));
  server_->Shutdown(1);
}

// Two jobs whose scenes are in the store and have the same image.
class StoredSceneTransfersTest : public TransfersTest {
 protected:
  void SetUp() override {
    TransfersTest::SetUp();
    if (IsSkipped()) return;
    stored_ = *StoredScenes::Open({ToText(s3_->location)}, s3_->location.endpoint, "", s3_->credentials.get(),
                                  &s3_->clock, {});
    environment_.stored_scenes = stored_.get();
    for (const std::string scene : {"a", "b"}) {
      Store(scene, content_);
      NewJob job = AJob(2);
      job.scene_path = ToText(s3_->location) + scene;
      job.scene_files = {{"image", image_}};
      job_ = Create(job);
    }
    RestartServer();
    worker_ = Register().worker();
    // The first job is that of the folder.
    const auto lease = LeaseOverRpc(worker_), second = LeaseOverRpc(worker_);
    ASSERT_TRUE(lease.has_lease() && second.has_lease());
    EXPECT_EQ(second.lease().spec().inputs(0).shared_path(), "");
  }
  void Store(const std::string& scene, const std::string& content) {
    ASSERT_TRUE(s3_->client->Put(scene + "/image", content, Sha256Hex(content)).ok());
  }

  const std::string content_ = std::string(1'500'000, 's') + "scene";
  const Digest image_ = DigestOf(content_);
  std::unique_ptr<StoredScenes> stored_;
  std::string job_;
};

TEST_F(StoredSceneTransfersTest, FilesAreReadWithoutTheCoordinator) {
  for (const bool blobs_in_store : {true, false}) {
    SCOPED_TRACE(blobs_in_store);
    local_ = *FolderBlobs::Open(folder_.path() + (blobs_in_store ? "/one" : "/two"));
    if (!blobs_in_store) environment_.transfers = nullptr;
    if (!blobs_in_store) environment_.blobs = blobs_.get();
    const Status fetched = Fetch(image_, *local_, worker_);
    ASSERT_TRUE(fetched.ok()) << fetched;
    EXPECT_EQ(*local_->Read(image_), content_);
    EXPECT_EQ(Passed(), 0);
  }
}

TEST_F(StoredSceneTransfersTest, OnlyAWorkerWithALeaseGetsUrls) {
  v1::GetTransfersRequest request;
  request.add_digests()->set_sha256(image_.sha256);
  request.mutable_digests(0)->set_size_bytes(image_.size_bytes);
  const auto ask = [&](const std::string& worker) {
    grpc::ClientContext context;
    if (!worker.empty()) As(context, worker);
    v1::GetTransfersResponse response;
    const grpc::Status status = blob_service_->GetTransfers(&context, request, &response);
    if (!status.ok() || response.transfers(0).requests().empty()) return false;
    return response.transfers(0).requests(0).url().find("a/image?") != std::string::npos;
  };
  EXPECT_TRUE(ask(worker_));
  EXPECT_FALSE(ask(Register().worker()));
  EXPECT_FALSE(ask(""));
}

TEST_F(StoredSceneTransfersTest, FileThatChangedIsReadFromAnotherSceneOrTold) {
  Store("a", std::string(content_.size(), '?'));
  ASSERT_TRUE(Fetch(image_, *local_, worker_).ok());
  EXPECT_EQ(*local_->Read(image_), content_);

  local_ = *FolderBlobs::Open(folder_.path() + "/again");
  ASSERT_TRUE(s3_->client->Delete({"a/image"}).ok());
  ASSERT_TRUE(Fetch(image_, *local_, worker_).ok());

  local_ = *FolderBlobs::Open(folder_.path() + "/none");
  Store("b", "short");
  const Status gone = Fetch(image_, *local_, worker_);
  EXPECT_EQ(gone.code(), absl::StatusCode::kNotFound) << gone;
  EXPECT_THAT(std::string(gone.message()), testing::HasSubstr("a/image was changed after its job was submitted"));
  EXPECT_EQ(Passed(), 0);
}

// As in an update whose base's scene may not be read any more.
TEST_F(StoredSceneTransfersTest, FileIsReadFromTheSceneThatMayBeRead) {
  *stored_ = std::move(**StoredScenes::Open({ToText(s3_->location) + "b"}, s3_->location.endpoint, "",
                                            s3_->credentials.get(), &s3_->clock, {}));
  const Status fetched = Fetch(image_, *local_, worker_);
  ASSERT_TRUE(fetched.ok()) << fetched;
  EXPECT_EQ(*local_->Read(image_), content_);
}

TEST_F(StoredSceneTransfersTest, BlobServiceReadsThemToo) {
  v1::ReadBlobRequest request;
  request.mutable_digest()->set_sha256(image_.sha256);
  request.mutable_digest()->set_size_bytes(image_.size_bytes);
  grpc::ClientContext context;
  As(context, worker_);
  const auto reader = blob_service_->ReadBlob(&context, request);
  v1::BlobChunk chunk;
  std::string read;
  while (reader->Read(&chunk)) read += chunk.data();
  EXPECT_TRUE(reader->Finish().ok());
  EXPECT_EQ(read, content_);
}

}  // namespace
}  // namespace tessera
