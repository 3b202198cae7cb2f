#include "common/rpc/blob_client.h"

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>

#include "common/base/random.h"
#include "common/rpc/channel.h"
#include "common/storage/files.h"
#include "common/storage/folder_blobs.h"
#include "tests/support/fake_blob_service.h"

namespace tessera {
namespace {

using testing::ElementsAre;

constexpr int64_t kMiB = 1 << 20;

std::string RandomBytes(int64_t size, uint64_t seed) {
  Random random(seed);
  std::string bytes(size, '\0');
  for (char& byte : bytes) byte = static_cast<char>(random.Bits());
  return bytes;
}

class BlobClientTest : public testing::Test {
 protected:
  BlobClientTest() : folder_(TempFolder::Create(testing::TempDir()).value()) {
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(&service_);
    builder.SetMaxReceiveMessageSize(16 << 20);
    AllowKeepalive(builder);
    server_ = builder.BuildAndStart();
    RetryPolicy policy;
    policy.max_attempts = 4;
    const auto channel = MakeChannel("127.0.0.1:" + std::to_string(port));
    // The test's sleeper does not wait, so a slow connection would use up all attempts.
    EXPECT_TRUE(channel->WaitForConnected(std::chrono::system_clock::now() + std::chrono::seconds(10)));
    client_ = std::make_unique<BlobClient>(channel, policy, [this](double) {
      ++waits_;
      return true;
    });
    store_ = FolderBlobs::Open(folder_.path() + "/store").value();
  }
  ~BlobClientTest() override { server_->Shutdown(); }

  std::string NewFile(const std::string& bytes) {
    const std::string path = folder_.path() + "/file";
    EXPECT_TRUE(WriteFileAtomic(path, bytes).ok());
    return path;
  }

  TempFolder folder_;
  FakeBlobService service_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<BlobClient> client_;
  std::unique_ptr<FolderBlobs> store_;
  int waits_ = 0;
};

TEST_F(BlobClientTest, FetchesAnySize) {
  for (const int64_t size : {int64_t{0}, int64_t{1}, kMiB - 1, kMiB, kMiB + 1, 3 * kMiB + 5}) {
    const Digest digest = service_.Add(RandomBytes(size, size));
    ASSERT_TRUE(client_->Fetch(digest, *store_, {}).ok()) << size;
    EXPECT_EQ(store_->Read(digest).value(), service_.Content(digest));
  }
  EXPECT_EQ(waits_, 0);
}

TEST_F(BlobClientTest, InterruptedFetchResumes) {
  const Digest digest = service_.Add(RandomBytes(5 * kMiB, 1));
  service_.BreakStreams(2, 2);
  ASSERT_TRUE(client_->Fetch(digest, *store_, {}).ok());
  EXPECT_THAT(service_.read_offsets(), ElementsAre(0, 2 * kMiB, 4 * kMiB));
  EXPECT_TRUE(store_->Verify(digest).ok());
}

TEST_F(BlobClientTest, FetchResumesPartialBlobOfEarlierProcess) {
  const std::string bytes = RandomBytes(3 * kMiB, 2);
  const Digest digest = service_.Add(bytes);
  ASSERT_TRUE(store_->Append(digest, 0, bytes.substr(0, kMiB + 17)).ok());
  ASSERT_TRUE(client_->Fetch(digest, *store_, {}).ok());
  EXPECT_THAT(service_.read_offsets(), ElementsAre(kMiB + 17));
  EXPECT_TRUE(store_->Verify(digest).ok());
}

TEST_F(BlobClientTest, DamagedChunkIsFetchedAgain) {
  const Digest digest = service_.Add(RandomBytes(2 * kMiB, 3));
  service_.DamageChunks(1);
  ASSERT_TRUE(client_->Fetch(digest, *store_, {}).ok());
  EXPECT_THAT(service_.read_offsets(), ElementsAre(0, 0));
  EXPECT_TRUE(store_->Verify(digest).ok());
}

TEST_F(BlobClientTest, ContentWithWrongDigestIsNotStored) {
  const Digest digest = service_.Add(RandomBytes(kMiB + 9, 4));
  service_.Replace(digest, RandomBytes(kMiB + 9, 5));
  EXPECT_EQ(client_->Fetch(digest, *store_, {}).code(), absl::StatusCode::kDataLoss);
  EXPECT_FALSE(store_->Has(digest));
  EXPECT_EQ(store_->CommittedBytes(digest).value(), 0);
}

TEST_F(BlobClientTest, CorruptPartialBlobIsDroppedAndFetchedAgain) {
  const Digest digest = service_.Add(RandomBytes(2 * kMiB, 6));
  ASSERT_TRUE(store_->Append(digest, 0, RandomBytes(kMiB, 7)).ok());
  ASSERT_TRUE(client_->Fetch(digest, *store_, {}).ok());
  EXPECT_THAT(service_.read_offsets(), ElementsAre(kMiB, 0));
  EXPECT_TRUE(store_->Verify(digest).ok());
}

TEST_F(BlobClientTest, FetchOfAnUnknownBlobFailsAtOnce) {
  const Digest digest{Sha256Hex("nobody has this"), 15};
  EXPECT_EQ(client_->Fetch(digest, *store_, {}).code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(waits_, 0);
}

TEST_F(BlobClientTest, FetchFailsAfterMaxAttemptsWithoutProgress) {
  const Digest digest = service_.Add(RandomBytes(kMiB, 8));
  service_.BreakStreams(1000, 0);
  EXPECT_EQ(client_->Fetch(digest, *store_, {}).code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(service_.read_offsets().size(), 4u);
}

TEST_F(BlobClientTest, FetchEndsWhenCancelled) {
  const Digest digest = service_.Add(RandomBytes(5 * kMiB, 9));
  TaskControl control;
  control.cancelled = [&] { return store_->CommittedBytes(digest).value() >= 2 * kMiB; };
  EXPECT_EQ(client_->Fetch(digest, *store_, control).code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(store_->CommittedBytes(digest).value(), 2 * kMiB);
}

TEST_F(BlobClientTest, SendsAnySizeAndSkipsStoredBytes) {
  for (const int64_t size : {int64_t{0}, int64_t{1}, kMiB, 2 * kMiB + 3}) {
    const std::string bytes = RandomBytes(size, 100 + size);
    const Digest digest{Sha256Hex(bytes), size};
    ASSERT_TRUE(client_->Send(NewFile(bytes), digest, {}).ok()) << size;
    EXPECT_EQ(service_.Content(digest), bytes);
    const size_t writes = service_.write_offsets().size();
    ASSERT_TRUE(client_->Send(NewFile(bytes), digest, {}).ok());
    EXPECT_EQ(service_.write_offsets().size(), writes);
  }
}

TEST_F(BlobClientTest, ReportsProgress) {
  std::vector<double> shares;
  TaskControl control;
  control.report = [&shares](double share, const std::string&) { shares.push_back(share); };
  const std::string bytes = RandomBytes(2 * kMiB, 12);
  const Digest digest{Sha256Hex(bytes), 2 * kMiB};
  ASSERT_TRUE(client_->Send(NewFile(bytes), digest, control).ok());
  EXPECT_THAT(shares, ElementsAre(0.5, 1));
  ASSERT_TRUE(client_->Fetch(digest, *store_, control).ok());
  EXPECT_THAT(shares, ElementsAre(0.5, 1, 0.5, 1));
}

TEST_F(BlobClientTest, InterruptedSendResumes) {
  const std::string bytes = RandomBytes(5 * kMiB, 10);
  const Digest digest{Sha256Hex(bytes), 5 * kMiB};
  service_.BreakStreams(2, 2);
  ASSERT_TRUE(client_->Send(NewFile(bytes), digest, {}).ok());
  EXPECT_THAT(service_.write_offsets(), ElementsAre(0, 2 * kMiB, 4 * kMiB));
  EXPECT_EQ(service_.Content(digest), bytes);
}

TEST_F(BlobClientTest, SendRejectsFileWithWrongDigest) {
  const Digest digest{Sha256Hex(RandomBytes(kMiB, 11)), kMiB};
  EXPECT_EQ(client_->Send(NewFile(RandomBytes(kMiB, 12)), digest, {}).code(), absl::StatusCode::kDataLoss);
  EXPECT_FALSE(service_.Holds(digest));
  EXPECT_EQ(client_->Send(NewFile("short"), digest, {}).code(), absl::StatusCode::kFailedPrecondition);
}

TEST(ChannelTest, UnreachableAddressIsUnavailableAndNamed) {
  const Status status = WaitConnected(*MakeChannel("127.0.0.1:1"), "127.0.0.1:1", 0.2);
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_NE(status.ToString().find("127.0.0.1:1"), std::string::npos);
}

}  // namespace
}  // namespace tessera
