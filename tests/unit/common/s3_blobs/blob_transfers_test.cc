// What the holder of a signed URL can do, tried on a real S3 store.
#include "common/s3_blobs/blob_transfers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "common/storage/files.h"
#include "tests/support/servers/test_s3.h"

namespace tessera {
namespace {

constexpr BlobTransferOptions kSmallParts = {.max_put_bytes = 6 << 20, .min_part_bytes = 5 << 20};

class MinutesAgo : public Clock {
 public:
  int64_t UnixTimeUs() const override { return real_.UnixTimeUs() - int64_t{600} * 1'000'000; }
  int64_t MonotonicUs() const override { return real_.MonotonicUs(); }

 private:
  SystemClock real_;
};

class BlobTransfersTest : public testing::Test {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("radosgw");
    s3_ = std::make_unique<TestS3>();
    store_ = *S3Blobs::Open(s3_->client.get(), &s3_->clock, folder_.path() + "/staging", 3600);
    transfers_ = std::make_unique<BlobTransfers>(s3_->client.get(), store_.get(), SignedHash::kContent, kSmallParts);
  }
  std::string File(const std::string& content) {
    const std::string path = folder_.path() + "/file";
    std::ofstream(path, std::ios::binary) << content;
    return path;
  }
  static Digest DigestOf(const std::string& content) {
    return {Sha256Hex(content), static_cast<int64_t>(content.size())};
  }
  SignedRequest UploadOf(const Digest& digest) {
    const auto upload = transfers_->Write(digest, {}, "");
    EXPECT_TRUE(upload.ok()) << upload.status();
    EXPECT_EQ(upload->requests.size(), 1u);
    return upload->requests.at(0);
  }
  Status Send(const SignedRequest& request, const std::string& content) {
    return direct_.Put(request, File(content), 0, static_cast<int64_t>(content.size())).status();
  }
  StatusOr<std::string> Receive(const SignedRequest& request) {
    std::string received;
    const Status status = direct_.Get(request, 0, [&](std::string_view bytes) {
      received.append(bytes);
      return absl::OkStatus();
    });
    if (!status.ok()) return status;
    return received;
  }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::unique_ptr<TestS3> s3_;
  std::unique_ptr<S3Blobs> store_;
  std::unique_ptr<BlobTransfers> transfers_;
  SignedTransfers direct_;
};

TEST_F(BlobTransfersTest, UrlsNeedNoCredentials) {
  const Digest digest = DigestOf("content");
  ASSERT_TRUE(Send(UploadOf(digest), "content").ok());
  EXPECT_TRUE(store_->Verify(digest).ok());
  EXPECT_TRUE(transfers_->Write(digest, {}, "")->stored);
  EXPECT_EQ(*Receive(*transfers_->Read(digest)), "content");
  EXPECT_EQ(Receive(*transfers_->Read(DigestOf("none"))).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(BlobTransfersTest, UploadOfOtherBytesIsRefused) {
  const Digest digest = DigestOf("content");
  SignedRequest request = UploadOf(digest);
  EXPECT_EQ(Send(request, "content and more").code(), absl::StatusCode::kDataLoss) << "refused before it is sent";
  request.headers.erase("content-length");  // the sender may send any size
  for (const std::string other : {"CONTENT", "content and more", ""}) {
    EXPECT_FALSE(Send(request, other).ok()) << other;
    EXPECT_FALSE(s3_->client->Head(S3Blobs::KeyOf(digest)).ok()) << other;
  }
  // Nor if the sender declares the hash of the other bytes.
  for (auto& [name, value] : request.headers) {
    if (value == digest.sha256) value = DigestOf("CONTENT").sha256;
  }
  EXPECT_FALSE(Send(request, "CONTENT").ok());
  EXPECT_FALSE(s3_->client->Head(S3Blobs::KeyOf(digest)).ok());
}

TEST_F(BlobTransfersTest, UrlIsOfOneContentAndOneMethod) {
  const Digest digest = *store_->PutBytes("content"), other = *store_->PutBytes("secret");
  SignedRequest read = *transfers_->Read(digest);
  ASSERT_TRUE(Receive(read).ok());
  const std::string key = S3Blobs::KeyOf(digest);
  const size_t at = read.url.find(key);
  ASSERT_NE(at, std::string::npos);
  SignedRequest changed = read;
  changed.url.replace(at, key.size(), S3Blobs::KeyOf(other));
  EXPECT_EQ(Receive(changed).status().code(), absl::StatusCode::kPermissionDenied);
  read.method = "PUT";
  EXPECT_EQ(Send(read, "damage").code(), absl::StatusCode::kPermissionDenied);
  EXPECT_TRUE(store_->Verify(digest).ok());
}

TEST_F(BlobTransfersTest, UrlIsRefusedAfterItsTime) {
  const Digest digest = *store_->PutBytes("content"), absent = DigestOf("absent");
  const MinutesAgo clock;
  const auto client = *S3Client::Create(s3_->location, s3_->credentials.get(), &clock);
  EXPECT_TRUE(Receive(*client->SignGet(S3Blobs::KeyOf(digest), 700)).ok());
  const auto late = Receive(*client->SignGet(S3Blobs::KeyOf(digest), 500));
  EXPECT_EQ(late.status().code(), absl::StatusCode::kPermissionDenied) << late.status();
  EXPECT_EQ(Send(*client->SignPut(S3Blobs::KeyOf(absent), absent.sha256, 6, 500), "absent").code(),
            absl::StatusCode::kPermissionDenied);
  EXPECT_FALSE(store_->Has(absent));
}

TEST_F(BlobTransfersTest, LargeContentIsSentInParts) {
  const std::string content = std::string(5 << 20, 'a') + std::string(5 << 20, 'b') + "end";
  const Digest digest = DigestOf(content);
  const auto sizes = transfers_->Write(digest, {}, "");
  ASSERT_TRUE(sizes.ok()) << sizes.status();
  EXPECT_EQ(sizes->part_bytes, 5 << 20);
  EXPECT_TRUE(sizes->requests.empty());
  const std::vector<std::string> hashes = {Sha256Hex(std::string(5 << 20, 'a')), Sha256Hex(std::string(5 << 20, 'b')),
                                           Sha256Hex("end")};
  EXPECT_EQ(transfers_->Write(digest, {hashes[0]}, "").status().code(), absl::StatusCode::kInvalidArgument);
  const auto upload = transfers_->Write(digest, hashes, "");
  ASSERT_TRUE(upload.ok()) << upload.status();
  ASSERT_EQ(upload->requests.size(), 3u);
  const std::string path = File(content);
  EXPECT_FALSE(direct_.Put(upload->requests[0], path, 1 << 20, 5 << 20).ok()) << "other bytes";
  SignedRequest any_size = upload->requests[0];
  any_size.headers.erase("content-length");
  EXPECT_FALSE(direct_.Put(any_size, path, 0, 0).ok()) << "no bytes";
  // URLs that have expired are made anew for the same upload.
  const auto again = transfers_->Write(digest, hashes, upload->id);
  ASSERT_TRUE(again.ok() && again->id == upload->id);
  std::vector<std::string> etags;
  for (int64_t part = 0; part < 3; ++part) {
    const int64_t offset = part * (5 << 20), size = std::min<int64_t>(5 << 20, digest.size_bytes - offset);
    const auto etag = direct_.Put((part < 1 ? upload : again)->requests[part], path, offset, size);
    ASSERT_TRUE(etag.ok()) << etag.status();
    etags.push_back(*etag);
  }
  EXPECT_FALSE(store_->Has(digest));
  ASSERT_TRUE(transfers_->Complete(digest, upload->id, etags).ok());
  EXPECT_TRUE(store_->Verify(digest).ok());
  EXPECT_TRUE(transfers_->Complete(digest, upload->id, etags).ok()) << "the answer was lost, and the call is repeated";
}

TEST_F(BlobTransfersTest, TheStoreIsFoundToEnforceTheHash) {
  const auto hash = TryUploads(*s3_->client, folder_.path());
  ASSERT_TRUE(hash.ok()) << hash.status();
  EXPECT_EQ(*hash, SignedHash::kContent);
  EXPECT_TRUE(s3_->client->List("")->objects.empty()) << "the probe is removed";
  const BlobTransfers none(s3_->client.get(), store_.get(), std::nullopt);
  EXPECT_FALSE(none.takes_uploads());
}

}  // namespace
}  // namespace tessera
