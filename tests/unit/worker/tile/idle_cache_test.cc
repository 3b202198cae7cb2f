#include "worker/tile/kept/idle_cache.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

namespace tessera {
namespace {

// A task on an object of 10 bytes: whether the object was kept.
bool Use(IdleCache<int>* cache, const std::string& key) {
  std::unique_ptr<int> object = cache->Take(key);
  const bool kept = object != nullptr;
  if (!kept) object = std::make_unique<int>(0);
  cache->Put(key, std::move(object), 10);
  return kept;
}

// How many of the objects each of `rounds` finds, if they are used in turn.
std::vector<int> FoundInTurns(IdleCache<int>* cache, const std::string& name, int objects, int rounds) {
  std::vector<int> found(rounds, 0);
  for (int round = 0; round < rounds; ++round) {
    for (int i = 0; i < objects; ++i) found[round] += Use(cache, name + std::to_string(i));
  }
  return found;
}

TEST(IdleCache, ObjectsThatFitAreKept) {
  IdleCache<int> cache(30);
  EXPECT_EQ(FoundInTurns(&cache, "a", 4, 3), (std::vector<int>{0, 4, 4})) << "three beside the one in use";
}

TEST(IdleCache, MostAreKeptIfNotAllFit) {
  IdleCache<int> cache(70);
  const std::vector<int> found = FoundInTurns(&cache, "a", 10, 8);
  for (size_t round = 2; round < found.size(); ++round) EXPECT_GE(found[round], 7) << round;
}

TEST(IdleCache, OneThatExceedsTheLimitServesTheNextTaskAlone) {
  IdleCache<int> cache(5);
  EXPECT_FALSE(Use(&cache, "a"));
  EXPECT_TRUE(Use(&cache, "a"));
  EXPECT_FALSE(Use(&cache, "b"));
  EXPECT_FALSE(Use(&cache, "a")) << "it was dropped before b was made";
  cache.Trim();
  EXPECT_FALSE(Use(&cache, "a"));
}

TEST(IdleCache, ObjectsOfAnotherJobMakeRoom) {
  IdleCache<int> cache(70);
  FoundInTurns(&cache, "old", 8, 3);
  const std::vector<int> found = FoundInTurns(&cache, "new", 8, 3);
  EXPECT_EQ(found, (std::vector<int>{0, 8, 8}));
}

TEST(IdleCache, AnObjectIsTakenOnce) {
  IdleCache<int> cache(100);
  cache.Put("a", std::make_unique<int>(7), 10);
  const std::unique_ptr<int> first = cache.Take("a");
  ASSERT_NE(first, nullptr);
  EXPECT_EQ(*first, 7);
  EXPECT_EQ(cache.Take("a"), nullptr);
}

}  // namespace
}  // namespace tessera
