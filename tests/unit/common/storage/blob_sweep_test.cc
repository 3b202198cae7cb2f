// What is taken out of a blob store is what nobody stores again.
#include "common/storage/blob_sweep.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <ctime>
#include <fstream>
#include <functional>

#include "common/storage/blob_store.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

using Kind = BlobFile::Kind;

class BlobSweepTest : public testing::Test {
 protected:
  std::vector<BlobFile> List() {
    std::vector<BlobFile> files;
    for (int part = 0; part < kBlobParts; ++part) {
      for (BlobFile& file : ListBlobFiles(blobs_->root(), part)) files.push_back(std::move(file));
    }
    return files;
  }
  // The only file, a day old.
  BlobFile Old(const Digest& digest) {
    const timespec day_ago = {std::time(nullptr) - 86400, 0}, times[] = {day_ago, day_ago};
    EXPECT_EQ(::utimensat(AT_FDCWD, blobs_->Path(digest).c_str(), times, 0), 0);
    const auto files = List();
    EXPECT_EQ(files.size(), 1u);
    return files.at(0);
  }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  std::unique_ptr<BlobStore> blobs_ = *BlobStore::Open(folder_.path() + "/blobs");
  const Digest digest_ = *blobs_->PutBytes("content");
};

TEST_F(BlobSweepTest, WhatIsTakenOutIsLeftOverUntilItIsRemoved) {
  const auto taken = TakeOut(blobs_->root(), Old(digest_));
  ASSERT_TRUE(taken.ok()) << taken.status();
  EXPECT_FALSE(blobs_->Has(digest_));
  const auto left = List();
  ASSERT_EQ(left.size(), 1u);
  EXPECT_EQ(left[0].kind, Kind::kLeftover);
  EXPECT_EQ(left[0].path, *taken);
  ASSERT_TRUE(TakeOut(blobs_->root(), left[0]).ok());
}

// Whoever finds it stored is about to refer to it.
TEST_F(BlobSweepTest, WhatIsStoredAgainStays) {
  const std::string path = folder_.path() + "/file";
  const std::function<void()> ways[] = {
      [&] { EXPECT_TRUE(blobs_->PutBytes("content").ok()); },
      [&] { EXPECT_TRUE(blobs_->PutParts([](const BlobStore::Writer& write) { write("content"); }).ok()); },
      [&] { EXPECT_TRUE(blobs_->PutFile(path).ok()); },
      [&] { EXPECT_TRUE(blobs_->MoveFile(path).ok()); },
      [&] { EXPECT_EQ(*blobs_->CommittedBytes(digest_), digest_.size_bytes) << "an uploader asks first"; },
      [&] { EXPECT_EQ(*blobs_->Append(digest_, 0, "content"), digest_.size_bytes); },
      [&] { EXPECT_TRUE(blobs_->Complete(digest_).ok()); },
  };
  for (size_t way = 0; way < std::size(ways); ++way) {
    SCOPED_TRACE(way);
    std::ofstream(path) << "content";
    const BlobFile old = Old(digest_);
    ways[way]();
    EXPECT_EQ(TakeOut(blobs_->root(), old).status().code(), absl::StatusCode::kNotFound);
    EXPECT_TRUE(blobs_->Verify(digest_).ok());
    EXPECT_GT(List().at(0).since_us, old.since_us + int64_t{3600} * 1'000'000);
  }
}

TEST_F(BlobSweepTest, WhatWasSetAsideIsAsOldAsThat) {
  const int64_t written_us = Old(digest_).since_us;
  std::ofstream(blobs_->Path(digest_), std::ios::in | std::ios::out) << "damage!";
  Old(digest_);
  EXPECT_FALSE(blobs_->VerifyOrSetAside(digest_).ok());
  const auto files = List();
  ASSERT_EQ(files.size(), 1u);
  EXPECT_EQ(files[0].kind, Kind::kSetAside);
  EXPECT_GT(files[0].since_us, written_us + int64_t{3600} * 1'000'000);
  EXPECT_TRUE(TakeOut(blobs_->root(), files[0]).ok());
}

}  // namespace
}  // namespace tessera
