#include "common/base/loops/parallel_sort.h"

#include <gtest/gtest.h>

#include "common/base/random.h"

namespace tessera {
namespace {

struct Numbered {
  int key = 0, number = 0;
  bool operator<(const Numbered& other) const { return key < other.key; }
  bool operator==(const Numbered& other) const = default;
};

TEST(ParallelSortTest, SortsAndKeepsTheOrderOfEqualElements) {
  Random random(3);
  for (const int threads : {1, 4}) {
    const ThreadLimit limit(threads);
    for (const int count : {0, 1, 16, 17, 32, 33, 160, 1000}) {
      std::vector<Numbered> values;
      for (int i = 0; i < count; ++i) values.push_back({static_cast<int>(random.Below(40)), i});
      std::vector<Numbered> expected = values;
      std::stable_sort(expected.begin(), expected.end());
      ParallelSort(&values, 16);
      EXPECT_EQ(values, expected) << count;
    }
  }
}

}  // namespace
}  // namespace tessera
