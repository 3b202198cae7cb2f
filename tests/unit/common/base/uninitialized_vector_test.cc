#include "common/base/loops/uninitialized_vector.h"

#include <gtest/gtest.h>

#include <cstdint>

namespace tessera {
namespace {

TEST(UninitializedVectorTest, NewElementsAreNotWritten) {
  UninitializedVector<uint32_t> values(1000, 7);
  values.clear();
  values.resize(1000);
  EXPECT_EQ(values[0], 7u);
  EXPECT_EQ(values[999], 7u);
  values.push_back(3);
  EXPECT_EQ(values.back(), 3u);
}

}  // namespace
}  // namespace tessera
