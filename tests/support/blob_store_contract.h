// Contract tests of BlobStore: an implementation instantiates BlobStoreTest with its own StoreCase. Include in one file
// of a test program.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "common/storage/blob_store.h"
#include "common/storage/files.h"
#include "tests/support/servers/test_server.h"

namespace tessera {

// A store and operations on it that bypass the interface.
class StoreCase {
 public:
  virtual ~StoreCase() = default;
  virtual BlobStore& store() = 0;
  // Opens the store again, like another process.
  virtual void Reopen() {}
  // Replaces the stored bytes in place.
  virtual void Damage(const Digest& digest, const std::string& bytes) = 0;
  // Makes the blob older than any grace period.
  virtual void MakeOld(const Digest& digest) = 0;
  // Whether the bytes of a removed blob are gone when Remove returns.
  virtual bool frees_at_once() const { return false; }
  // Whether each part takes a request to list.
  virtual bool is_remote() const { return false; }
};

struct BlobStoreImplementation {
  std::string name;
  std::function<std::unique_ptr<StoreCase>()> make;
};

class BlobStoreTest : public testing::TestWithParam<BlobStoreImplementation> {
 protected:
  // A store on a server that does not run: null.
  void SetUp() override {
    if (case_ != nullptr) return;
    if (ServersAreRequired()) FAIL() << "the server of the store is not started";
    GTEST_SKIP() << "the server of the store is not started: run the test by ctest";
  }
  BlobStore& store() { return case_->store(); }
  std::string File(const std::string& content) {
    const std::string path = folder_.path() + "/file";
    std::ofstream(path, std::ios::binary) << content;
    return path;
  }
  static Digest DigestOf(const std::string& content) {
    return {Sha256Hex(content), static_cast<int64_t>(content.size())};
  }
  // All objects. The tests store these contents alone.
  std::vector<BlobEntry> List() {
    std::set<int> parts = {BlobStore::kParts - 2, BlobStore::kParts - 1};  // unfinished and quarantined ones
    for (const std::string& content : {content_, std::string("content"), Numbered(0), Numbered(1), Numbered(2)}) {
      parts.insert(std::stoi(Sha256Hex(content).substr(0, 2), nullptr, 16));
    }
    for (int part = 0; part < BlobStore::kParts && !case_->is_remote(); ++part) parts.insert(part);
    std::vector<BlobEntry> entries;
    for (const int part : parts) {
      const auto listed = store().List(part);
      EXPECT_TRUE(listed.ok()) << listed.status();
      if (listed.ok()) entries.insert(entries.end(), listed->begin(), listed->end());
    }
    return entries;
  }
  // The only object of the store.
  BlobEntry Only() {
    const auto entries = List();
    EXPECT_EQ(entries.size(), 1u);
    return entries.empty() ? BlobEntry() : entries[0];
  }
  BlobEntry Old(const Digest& digest) {
    case_->MakeOld(digest);
    return Only();
  }

  static std::string Numbered(int i) { return "content " + std::to_string(i); }

  TempFolder folder_ = *TempFolder::Create(testing::TempDir());
  const std::unique_ptr<StoreCase> case_ = GetParam().make();
  const std::string content_ = std::string(300000, 'x') + "end";
};

TEST_P(BlobStoreTest, AllPutMethodsStoreTheSameBlob) {
  const Digest digest = DigestOf(content_);
  EXPECT_EQ(store().Stat(digest).code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(*store().PutFile(File(content_)), digest);
  EXPECT_TRUE(store().Stat(digest).ok());
  EXPECT_TRUE(FileExists(folder_.path() + "/file"));
  EXPECT_EQ(*store().MoveFile(File(content_)), digest);
  EXPECT_FALSE(FileExists(folder_.path() + "/file"));
  EXPECT_EQ(*store().PutBytes(content_), digest);
  EXPECT_EQ(*store().PutParts([&](const BlobStore::Writer& write) {
    write(content_.substr(0, 7));
    write(content_.substr(7));
  }),
            digest);
  EXPECT_EQ(*store().Read(digest), content_);
  EXPECT_EQ(Only().sha256, digest.sha256);
  EXPECT_FALSE(store().PutFile(folder_.path() + "/none").ok());
  EXPECT_FALSE(store().MoveFile(folder_.path() + "/none").ok());
  EXPECT_EQ(List().size(), 1u);
}

TEST_P(BlobStoreTest, ReadsRanges) {
  const Digest digest = *store().PutBytes(content_);
  EXPECT_EQ(*store().ReadRange(digest, 0, 10), "xxxxxxxxxx");
  EXPECT_EQ(*store().ReadRange(digest, digest.size_bytes - 4, 100), "xend");
  EXPECT_EQ(*store().ReadRange(digest, digest.size_bytes, 100), "");
  EXPECT_EQ(store().ReadRange(DigestOf("none"), 0, 1).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(store().Read(digest, 100).status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(store().Read(DigestOf("none")).status().code(), absl::StatusCode::kNotFound);
}

TEST_P(BlobStoreTest, MalformedDigestsAreRefused) {
  const Digest none = {"../../etc/passwd", 3};
  for (const Status& status :
       {store().Stat(none), store().ReadRange(none, 0, 1).status(), store().Read(none).status(), store().Verify(none),
        store().VerifyOrQuarantine(none), store().Touch(none), store().CommittedBytes(none).status(),
        store().Append(none, 0, "x").status(), store().Complete(none)}) {
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << status;
  }
}

TEST_P(BlobStoreTest, DamagedBlobIsDetectedAndReplaced) {
  const Digest digest = *store().PutFile(File(content_));
  EXPECT_TRUE(store().Verify(digest).ok());
  std::string damaged = content_;
  damaged[5] ^= 1;
  const std::function<StatusOr<Digest>()> ways[] = {
      [&] { return store().PutBytes(content_); },
      [&] { return store().PutFile(File(content_)); },
      [&] { return store().MoveFile(File(content_)); },
      [&] { return store().PutParts([&](const BlobStore::Writer& write) { write(content_); }); },
  };
  for (const auto& store_again : ways) {
    case_->Damage(digest, damaged);
    EXPECT_EQ(store().Verify(digest).code(), absl::StatusCode::kDataLoss);
    EXPECT_EQ(store().Read(digest).status().code(), absl::StatusCode::kDataLoss);
    EXPECT_TRUE(store_again().ok());
    EXPECT_EQ(*store().Read(digest), content_);
  }
  case_->Damage(digest, "short");
  EXPECT_FALSE(store().Has(digest));
  EXPECT_EQ(store().Verify(digest).code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(store().Read(digest).status().code(), absl::StatusCode::kDataLoss);
}

TEST_P(BlobStoreTest, DamagedBlobIsQuarantinedAndCanBeStoredAgain) {
  const Digest digest = *store().PutFile(File(content_));
  EXPECT_TRUE(store().VerifyOrQuarantine(digest).ok());
  EXPECT_TRUE(store().Has(digest));
  std::string damaged = content_;
  damaged[5] ^= 1;
  case_->Damage(digest, damaged);
  EXPECT_TRUE(store().Has(digest)) << "Stat does not read the content";
  EXPECT_EQ(store().VerifyOrQuarantine(digest).code(), absl::StatusCode::kDataLoss);
  EXPECT_FALSE(store().Has(digest));
  EXPECT_EQ(store().VerifyOrQuarantine(digest).code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(Only().kind, BlobEntry::Kind::kQuarantined);
  EXPECT_EQ(*store().CommittedBytes(digest), 0);
  ASSERT_TRUE(store().Append(digest, 0, content_).ok());
  ASSERT_TRUE(store().Complete(digest).ok());
  EXPECT_EQ(*store().Read(digest), content_);
}

TEST_P(BlobStoreTest, QuarantinedBlobHasTheTimeOfItsQuarantine) {
  const Digest digest = *store().PutBytes("content");
  case_->Damage(digest, "damage!");
  const int64_t written_us = Old(digest).since_us;
  EXPECT_FALSE(store().VerifyOrQuarantine(digest).ok());
  const BlobEntry entry = Only();
  EXPECT_GT(entry.since_us, written_us);
  ASSERT_TRUE(store().Remove(entry).ok());
}

TEST_P(BlobStoreTest, UploadResumesAfterReopening) {
  const Digest digest = DigestOf(content_);
  EXPECT_EQ(*store().CommittedBytes(digest), 0);
  EXPECT_EQ(*store().Append(digest, 0, content_.substr(0, 1000)), 1000);
  case_->Reopen();
  EXPECT_EQ(*store().CommittedBytes(digest), 1000);
  EXPECT_EQ(Only().kind, BlobEntry::Kind::kLeftover);
  EXPECT_EQ(store().Append(digest, 2000, "gap").status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(store().Append(digest, digest.size_bytes, "x").status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(store().Complete(digest).code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(*store().Append(digest, 500, content_.substr(500)), digest.size_bytes);  // overlaps
  EXPECT_FALSE(store().Has(digest));
  EXPECT_TRUE(store().Complete(digest).ok());
  EXPECT_EQ(*store().Read(digest), content_);
  EXPECT_TRUE(store().Complete(digest).ok());
  EXPECT_EQ(*store().CommittedBytes(digest), digest.size_bytes);
}

TEST_P(BlobStoreTest, UploadOfWrongBytesIsDropped) {
  const Digest digest = DigestOf(content_);
  std::string wrong = content_;
  wrong[7] = 'z';
  ASSERT_TRUE(store().Append(digest, 0, wrong).ok());
  EXPECT_EQ(store().Complete(digest).code(), absl::StatusCode::kDataLoss);
  EXPECT_TRUE(List().empty());
  EXPECT_EQ(*store().CommittedBytes(digest), 0);
}

TEST_P(BlobStoreTest, EmptyBlob) {
  EXPECT_TRUE(store().Complete(DigestOf("")).ok());
  EXPECT_EQ(*store().Read(DigestOf("")), "");
}

TEST_P(BlobStoreTest, ConcurrentUploadsOfOneBlob) {
  const Digest digest = DigestOf(content_);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int64_t at = 0; at < digest.size_bytes; at += 5000) {
        EXPECT_TRUE(store().Append(digest, at, content_.substr(static_cast<size_t>(at), 5000)).ok());
      }
      EXPECT_TRUE(store().Complete(digest).ok());
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(*store().Read(digest), content_);
}

TEST_P(BlobStoreTest, RemovedBlobIsALeftoverUntilItsBytesAreFreed) {
  const Digest digest = *store().PutBytes("content");
  const auto free_bytes = store().Remove(Old(digest));
  ASSERT_TRUE(free_bytes.ok()) << free_bytes.status();
  EXPECT_FALSE(store().Has(digest));
  if (case_->frees_at_once()) {
    EXPECT_TRUE(List().empty());
    return;
  }
  const BlobEntry left = Only();
  EXPECT_EQ(left.kind, BlobEntry::Kind::kLeftover);
  EXPECT_EQ(left.size_bytes, digest.size_bytes);
  (*free_bytes)();
  EXPECT_TRUE(List().empty());
  EXPECT_EQ(store().Remove(left).status().code(), absl::StatusCode::kNotFound);
}

TEST_P(BlobStoreTest, LeftoverCanBeRemoved) {
  ASSERT_TRUE(store().Append(DigestOf("content"), 0, "con").ok());
  const auto free_bytes = store().Remove(Only());
  ASSERT_TRUE(free_bytes.ok());
  (*free_bytes)();
  EXPECT_TRUE(List().empty());
}

TEST_P(BlobStoreTest, AnyTimeRemovesABlobRegardlessOfItsTime) {
  const Digest digest = *store().PutBytes("content");
  EXPECT_TRUE(store().Remove({BlobEntry::Kind::kBlob, "", digest.sha256, digest.size_bytes, BlobEntry::kAnyTime}).ok());
  EXPECT_FALSE(store().Has(digest));
}

TEST_P(BlobStoreTest, SeveralAreRemovedAtOnce) {
  std::vector<Digest> digests;
  for (int i = 0; i < 3; ++i) {
    digests.push_back(*store().PutBytes(Numbered(i)));
    case_->MakeOld(digests.back());
  }
  const std::vector<BlobEntry> listed = List();
  ASSERT_EQ(listed.size(), 3u);
  ASSERT_TRUE(store().Touch({listed[1].sha256, listed[1].size_bytes}).ok());
  ASSERT_TRUE(store().Append(DigestOf("unfinished"), 0, "un").ok());
  std::vector<BlobEntry> to_remove = listed;
  for (const BlobEntry& entry : List()) {
    if (entry.kind == BlobEntry::Kind::kLeftover) to_remove.push_back(entry);
  }
  ASSERT_EQ(to_remove.size(), 4u);
  int asked = 0;
  EXPECT_EQ(store().RemoveAll(to_remove, [] { return false; }).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(List().size(), 4u);
  const auto removed = store().RemoveAll(to_remove, [&] { return ++asked > 0; });
  EXPECT_GT(asked, 0);
  ASSERT_TRUE(removed.ok()) << removed.status();
  EXPECT_EQ(removed->entries.size(), 3u);
  removed->free_bytes();
  EXPECT_EQ(Only().sha256, listed[1].sha256) << "it was touched after it was listed";
}

// The second caller is about to refer to the blob.
TEST_P(BlobStoreTest, BlobStoredAgainIsNotRemoved) {
  const Digest digest = *store().PutBytes("content");
  const std::string path = folder_.path() + "/file";
  const std::function<void()> ways[] = {
      [&] { EXPECT_TRUE(store().PutBytes("content").ok()); },
      [&] { EXPECT_TRUE(store().PutParts([](const BlobStore::Writer& write) { write("content"); }).ok()); },
      [&] { EXPECT_TRUE(store().PutFile(path).ok()); },
      [&] { EXPECT_TRUE(store().MoveFile(path).ok()); },
      [&] { EXPECT_TRUE(store().Touch(digest).ok()); },
      [&] { EXPECT_EQ(*store().CommittedBytes(digest), digest.size_bytes) << "an uploader queries first"; },
      [&] { EXPECT_EQ(*store().Append(digest, 0, "content"), digest.size_bytes); },
      [&] { EXPECT_TRUE(store().Complete(digest).ok()); },
  };
  for (size_t way = 0; way < std::size(ways); ++way) {
    SCOPED_TRACE(way);
    std::ofstream(path) << "content";
    const BlobEntry old = Old(digest);
    ways[way]();
    EXPECT_EQ(store().Remove(old).status().code(), absl::StatusCode::kNotFound);
    EXPECT_TRUE(store().Verify(digest).ok());
    EXPECT_GT(Only().since_us, old.since_us);
  }
  EXPECT_EQ(store().Touch(DigestOf("none")).code(), absl::StatusCode::kNotFound);
}

TEST_P(BlobStoreTest, LocalPathHasTheContent) {
  const Digest digest = *store().PutBytes("content");
  EXPECT_FALSE(store().Location().empty());
  const auto path = store().LocalPath(digest);
  if (path) {
    EXPECT_EQ(*ReadFile(*path), "content");
  }
}

}  // namespace tessera
