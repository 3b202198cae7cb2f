#include <gtest/gtest.h>

#include <future>

#include "tests/support/memory_blobs.h"
#include "tests/support/watched_blobs.h"

namespace tessera {
namespace {

TEST(StatMany, AsksAboutSeveralBlobsAtOnceAndAnswersInOrder) {
  MemoryBlobs memory;
  WatchedBlobs blobs(&memory);
  std::vector<Digest> digests;
  for (int i = 0; i < 50; ++i) {
    const std::string content = std::to_string(i);
    digests.push_back({Sha256Hex(content), static_cast<int64_t>(content.size())});
    ASSERT_TRUE(i % 3 == 0 || memory.PutBytes(content).ok());
  }
  blobs.Hold();
  auto found = std::async(std::launch::async, [&] { return StatMany(blobs, digests); });
  EXPECT_TRUE(blobs.AwaitHeld(BlobStore::kCallsAtOnce));
  blobs.Release();
  const std::vector<Status> stored = found.get();
  ASSERT_EQ(stored.size(), digests.size());
  for (int i = 0; i < 50; ++i) {
    EXPECT_EQ(stored[i].code(), i % 3 > 0 ? absl::StatusCode::kOk : absl::StatusCode::kNotFound) << i;
  }
  EXPECT_EQ(blobs.most_at_once(), BlobStore::kCallsAtOnce);
  EXPECT_EQ(blobs.calls(), 50);
  EXPECT_TRUE(StatMany(blobs, {}).empty());
}

}  // namespace
}  // namespace tessera
