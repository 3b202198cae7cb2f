#include "worker/agent/blob_cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <latch>
#include <string>

#include "common/base/parallel.h"
#include "common/storage/files.h"

namespace tessera {
namespace {

class BlobCacheTest : public testing::Test {
 protected:
  BlobCacheTest() : folder_(TempFolder::Create(testing::TempDir()).value()) { Open(1000); }

  void Open(int64_t max_bytes) {
    cache_ = nullptr;
    cache_ = BlobCache::Open(folder_.path() + "/cache", max_bytes).value();
  }
  static std::string Content(char name) { return std::string(400, name); }
  static Digest DigestOf(char name) { return {Sha256Hex(Content(name)), 400}; }
  // Gets the content called `name`. `release`: releases it at once.
  std::string Get(char name, bool release = true) {
    const auto path = cache_->Get(DigestOf(name), [&](const Digest& digest, BlobStore& store) {
      ++fetches_;
      TESSERA_RETURN_IF_ERROR(store.Append(digest, 0, Content(name)).status());
      return store.Complete(digest);
    });
    EXPECT_TRUE(path.ok()) << path.status();
    EXPECT_EQ(ReadFile(*path).value(), Content(name));
    if (release) cache_->Release();
    return *path;
  }

  TempFolder folder_;
  std::unique_ptr<BlobCache> cache_;
  int fetches_ = 0;
};

TEST_F(BlobCacheTest, FetchesOnceAndDropsTheLeastRecentlyUsed) {
  Get('a');
  Get('b');
  Get('a');
  EXPECT_EQ(fetches_, 2);
  Get('c');  // b is the least recently used
  EXPECT_TRUE(cache_->Holds(DigestOf('a')));
  EXPECT_FALSE(cache_->Holds(DigestOf('b')));
  EXPECT_TRUE(cache_->Holds(DigestOf('c')));
  EXPECT_EQ(cache_->size_bytes(), 800);
}

TEST_F(BlobCacheTest, FilesInUseAreNotEvicted) {
  const std::string a = Get('a', false);
  const std::string b = Get('b', false);
  const std::string c = Get('c', false);
  for (const std::string& path : {a, b, c}) EXPECT_TRUE(FileExists(path));
  EXPECT_EQ(cache_->size_bytes(), 1200);
  cache_->Release();
  EXPECT_EQ(cache_->size_bytes(), 800);
  EXPECT_FALSE(FileExists(a));
}

TEST_F(BlobCacheTest, ContentSurvivesARestart) {
  Get('a');
  Open(1000);
  EXPECT_EQ(cache_->size_bytes(), 400);
  Get('a');
  EXPECT_EQ(fetches_, 1);
  Open(100);
  EXPECT_EQ(cache_->size_bytes(), 0);
}

TEST_F(BlobCacheTest, DamagedContentOfAPreviousProcessIsFetchedAgain) {
  const std::string path = Get('a');
  ASSERT_TRUE(WriteFileAtomic(path, Content('z')).ok());
  Open(1000);
  Get('a');
  EXPECT_EQ(fetches_, 2);
}

TEST_F(BlobCacheTest, ContentDamagedAtRunTimeIsFetchedAgain) {
  const std::string path = Get('a');
  ASSERT_TRUE(WriteFileAtomic(path, Content('z')).ok());
  Get('a');
  EXPECT_EQ(fetches_, 2);
  Get('a');
  EXPECT_EQ(fetches_, 2);
}

TEST_F(BlobCacheTest, FailedFetchLeavesNoEntry) {
  const auto path = cache_->Get(DigestOf('a'), [](const Digest&, BlobStore&) { return absl::NotFoundError("gone"); });
  EXPECT_EQ(path.status().code(), absl::StatusCode::kNotFound);
  EXPECT_FALSE(cache_->Holds(DigestOf('a')));
  EXPECT_EQ(cache_->size_bytes(), 0);
}

TEST_F(BlobCacheTest, AdoptsAFile) {
  const std::string file = folder_.path() + "/made here";
  ASSERT_TRUE(WriteFileAtomic(file, Content('a')).ok());
  ASSERT_TRUE(cache_->Adopt(file, DigestOf('a')).ok());
  EXPECT_FALSE(FileExists(file));
  Get('a');
  EXPECT_EQ(fetches_, 0);
}

TEST_F(BlobCacheTest, DifferentBlobsAreFetchedAtOnceAndTheSameOneOnce) {
  Open(1 << 20);
  constexpr int kThreads = 8;
  std::latch all_fetch(kThreads / 2);
  std::atomic<int> fetches = 0;
  ConcurrentForEach(kThreads, kThreads, [&](int64_t i) {
    const char name = static_cast<char>('a' + i / 2);
    const auto path = cache_->Get(DigestOf(name), [&](const Digest& digest, BlobStore& store) {
      ++fetches;
      all_fetch.arrive_and_wait();  // returns only if the others fetch meanwhile
      TESSERA_RETURN_IF_ERROR(store.Append(digest, 0, Content(name)).status());
      return store.Complete(digest);
    });
    EXPECT_TRUE(path.ok() && ReadFile(*path).value_or("") == Content(name)) << path.status();
  });
  EXPECT_EQ(fetches, kThreads / 2);
  EXPECT_EQ(cache_->size_bytes(), 400 * kThreads / 2);
}

TEST_F(BlobCacheTest, BlobThatAnotherCallFailedToFetchIsFetchedAgain) {
  std::atomic<int> fetches = 0, stored = 0;
  ConcurrentForEach(2, 2, [&](int64_t) {
    const auto path = cache_->Get(DigestOf('a'), [&](const Digest& digest, BlobStore& store) -> Status {
      if (++fetches == 1) return absl::UnavailableError("the first one fails");
      TESSERA_RETURN_IF_ERROR(store.Append(digest, 0, Content('a')).status());
      return store.Complete(digest);
    });
    stored += path.ok();
  });
  EXPECT_EQ(fetches, 2);
  EXPECT_EQ(stored, 1);
  EXPECT_TRUE(cache_->Holds(DigestOf('a')));
}

TEST_F(BlobCacheTest, BlobsBeingFetchedCountForTheLimit) {
  Get('a');
  Get('b');
  // 'c' and 'd' are both in flight when the second makes room: 'a' and 'b' go.
  std::latch both_fetch(2);
  ConcurrentForEach(2, 2, [&](int64_t i) {
    const char name = static_cast<char>('c' + i);
    const auto path = cache_->Get(DigestOf(name), [&](const Digest& digest, BlobStore& store) {
      both_fetch.arrive_and_wait();
      TESSERA_RETURN_IF_ERROR(store.Append(digest, 0, Content(name)).status());
      return store.Complete(digest);
    });
    EXPECT_TRUE(path.ok()) << path.status();
  });
  EXPECT_FALSE(cache_->Holds(DigestOf('a')));
  EXPECT_FALSE(cache_->Holds(DigestOf('b')));
  EXPECT_EQ(cache_->size_bytes(), 800);
}

}  // namespace
}  // namespace tessera
