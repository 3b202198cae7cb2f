#include "worker/agent/blob_cache.h"

#include <gtest/gtest.h>

#include <string>

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

}  // namespace
}  // namespace tessera
