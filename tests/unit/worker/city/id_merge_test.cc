#include "worker/city/id_merge.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "common/base/random.h"

namespace tessera {
namespace {

// Ids below `end`, each with this probability.
std::vector<uint32_t> SomeIds(uint32_t end, double share, Random* random) {
  std::vector<uint32_t> ids;
  for (uint32_t id = 0; id < end; ++id) {
    if (random->Uniform() < share) ids.push_back(id);
  }
  return ids;
}

std::vector<std::array<size_t, 2>> Shared(const std::vector<uint32_t>& some, const std::vector<uint32_t>& all) {
  std::vector<std::array<size_t, 2>> found;
  ForSharedIds(some, all, [&](size_t i, size_t k) { found.push_back({i, k}); });
  return found;
}

TEST(ForSharedIds, FindsEachIdOfBothListsHoweverDenseTheyAre) {
  Random random(3);
  for (const double share : {0.0, 0.001, 0.05, 0.5, 1.0}) {
    for (const double other : {0.0, 0.001, 0.05, 0.5, 1.0}) {
      const std::vector<uint32_t> some = SomeIds(3000, share, &random), all = SomeIds(3000, other, &random);
      std::vector<std::array<size_t, 2>> expected;
      for (size_t i = 0; i < some.size(); ++i) {
        const auto at = std::lower_bound(all.begin(), all.end(), some[i]);
        if (at != all.end() && *at == some[i]) expected.push_back({i, static_cast<size_t>(at - all.begin())});
      }
      EXPECT_EQ(Shared(some, all), expected) << share << " and " << other;
    }
  }
}

TEST(ForSharedIds, FindsRepeatedIds) {
  using Pairs = std::vector<std::array<size_t, 2>>;
  EXPECT_EQ(Shared({2, 2, 5, 5, 9}, {1, 2, 3, 5, 8}), (Pairs{{0, 1}, {1, 1}, {2, 3}, {3, 3}}));
}

}  // namespace
}  // namespace tessera
