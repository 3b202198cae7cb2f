// The contract of BlobStore over a bucket of a real S3 store, and what is particular to S3.
#include "common/s3_blobs/s3_blobs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "common/storage/files.h"
#include "tests/support/blob_store_contract.h"
#include "tests/support/servers/test_s3.h"

namespace tessera {
namespace {

using Kind = BlobEntry::Kind;

constexpr double kGrace_s = 3600;

// The store's clock cannot be set, so this one is set ahead.
class AheadClock : public Clock {
 public:
  int64_t UnixTimeUs() const override { return real_.UnixTimeUs() + ahead_us; }
  int64_t MonotonicUs() const override { return real_.MonotonicUs(); }
  std::atomic<int64_t> ahead_us = 0;

 private:
  SystemClock real_;
};

class S3Case : public StoreCase {
 public:
  BlobStore& store() override { return *store_; }
  void Reopen() override { store_ = *S3Blobs::Open(s3_.client.get(), &clock_, folder_.path() + "/staging", kGrace_s); }
  void Damage(const Digest& digest, const std::string& bytes) override {
    EXPECT_TRUE(s3_.client->Put(S3Blobs::KeyOf(digest), bytes, Sha256Hex(bytes)).ok());
  }
  void MakeOld(const Digest&) override { clock_.ahead_us = int64_t{86400} * 1'000'000; }
  bool frees_at_once() const override { return true; }
  bool is_remote() const override { return true; }

 private:
  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  AheadClock clock_;
  TestS3 s3_;
  std::unique_ptr<S3Blobs> store_ = *S3Blobs::Open(s3_.client.get(), &clock_, folder_.path() + "/staging", kGrace_s);
};

}  // namespace

// Without the server there is no store to test.
INSTANTIATE_TEST_SUITE_P(Stores, BlobStoreTest,
                         testing::Values(BlobStoreImplementation{"S3",
                                                                 []() -> std::unique_ptr<StoreCase> {
                                                                   if (ServerAddress("radosgw").empty()) return nullptr;
                                                                   return std::make_unique<S3Case>();
                                                                 }}),
                         [](const testing::TestParamInfo<BlobStoreImplementation>& info) { return info.param.name; });

namespace {

class S3BlobsTest : public testing::Test {
 protected:
  void SetUp() override {
    TESSERA_NEED_SERVER("radosgw");
    s3_ = std::make_unique<TestS3>();
    store_ = *S3Blobs::Open(s3_->client.get(), &clock_, folder_.path() + "/staging", kGrace_s);
  }
  // Times of the blob's object, as the store lists it.
  int64_t TimeOf(const Digest& digest) {
    const auto page = s3_->client->List(S3Blobs::KeyOf(digest));
    EXPECT_TRUE(page.ok() && page->objects.size() == 1) << page.status();
    return page->objects.at(0).modified_us;
  }
  std::vector<BlobEntry> List(int part) {
    auto listed = store_->List(part);
    EXPECT_TRUE(listed.ok()) << listed.status();
    return *std::move(listed);
  }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  AheadClock clock_;
  std::unique_ptr<TestS3> s3_;
  std::unique_ptr<S3Blobs> store_;
};

TEST_F(S3BlobsTest, TouchRenewsOnlyBlobsOlderThanHalfTheGracePeriod) {
  const Digest digest = *store_->PutBytes("content");
  const int64_t stored_us = TimeOf(digest);
  clock_.ahead_us = static_cast<int64_t>(0.49 * kGrace_s * 1e6);
  ASSERT_TRUE(store_->Touch(digest).ok());
  EXPECT_EQ(TimeOf(digest), stored_us);
  clock_.ahead_us = static_cast<int64_t>(0.51 * kGrace_s * 1e6);
  ASSERT_TRUE(store_->Touch(digest).ok());
  EXPECT_GT(TimeOf(digest), stored_us);
  EXPECT_EQ(*store_->Read(digest), "content");
}

TEST_F(S3BlobsTest, UnfinishedMultipartUploadIsALeftover) {
  const Digest digest = *store_->PutBytes("other");
  const std::string key = S3Blobs::KeyOf(digest);
  ASSERT_TRUE(s3_->client->StartUpload(key).ok());
  const auto left = List(BlobStore::kParts - 2);
  ASSERT_EQ(left.size(), 1u);
  EXPECT_EQ(left[0].kind, Kind::kLeftover);
  SystemClock now;
  EXPECT_LT(std::abs(left[0].since_us - now.UnixTimeUs()), int64_t{600} * 1'000'000);
  ASSERT_TRUE(store_->Remove(left[0]).ok());
  EXPECT_TRUE(List(BlobStore::kParts - 2).empty());
  EXPECT_TRUE(store_->Has(digest));
}

TEST_F(S3BlobsTest, LargeFileIsSentInParts) {
  const std::string path = folder_.path() + "/large";
  {
    std::ofstream file(path, std::ios::binary);
    for (int mib = 0; mib < 70; ++mib) file << std::string(1 << 20, static_cast<char>('a' + mib % 26));
  }
  const Digest digest = *HashFile(path);
  EXPECT_EQ(*store_->MoveFile(path), digest);
  EXPECT_FALSE(FileExists(path));
  EXPECT_TRUE(store_->Verify(digest).ok());
  EXPECT_EQ(*store_->ReadRange(digest, 64 << 20, 3), "mmm");
}

TEST_F(S3BlobsTest, OtherObjectsOfTheBucketAreNotListed) {
  ASSERT_TRUE(s3_->client->Put("blobs/ab/notes", "text", Sha256Hex("text")).ok());
  ASSERT_TRUE(s3_->client->Put("probe/1", "text", Sha256Hex("text")).ok());
  for (const int part : {0, 0xab, 0xff, BlobStore::kParts - 2, BlobStore::kParts - 1}) {
    EXPECT_TRUE(List(part).empty()) << part;
  }
}

TEST_F(S3BlobsTest, OpenTellsThatTheBucketIsMissing) {
  S3Location location = NewTestLocation();
  location.bucket = "no-such-bucket";
  const TestS3 other({}, location);
  const auto opened = S3Blobs::Open(other.client.get(), &clock_, folder_.path() + "/other", kGrace_s);
  EXPECT_EQ(opened.status().code(), absl::StatusCode::kFailedPrecondition) << opened.status();
  EXPECT_THAT(std::string(opened.status().message()), testing::HasSubstr("no-such-bucket"));
}

}  // namespace
}  // namespace tessera
