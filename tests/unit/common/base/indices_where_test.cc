#include "common/base/loops/indices_where.h"

#include <gtest/gtest.h>

#include <atomic>

namespace tessera {
namespace {

TEST(IndicesWhereTest, GivesThoseThatPassAscending) {
  for (const int threads : {1, 4}) {
    const ThreadLimit limit(threads);
    for (const size_t count : {size_t{0}, size_t{1}, size_t{10}, size_t{11}, size_t{1003}}) {
      std::vector<uint32_t> expected;
      for (uint32_t i = 0; i < count; ++i) {
        if (i % 3 != 1) expected.push_back(i);
      }
      std::atomic<size_t> calls = 0;
      EXPECT_EQ(IndicesWhere(count, 10, [&](uint32_t i) { return ++calls, i % 3 != 1; }), expected);
      EXPECT_EQ(calls, count);
    }
  }
}

}  // namespace
}  // namespace tessera
