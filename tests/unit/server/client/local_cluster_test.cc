#include "server/client/local_cluster.h"

#include <gtest/gtest.h>

#include <limits>

namespace tessera {
namespace {

constexpr int64_t kGiB = int64_t{1} << 30;

TEST(LocalCluster, HasAWorkerPerFourCoresWithMemoryForATileEach) {
  EXPECT_EQ(WorkersFor(1, 64 * kGiB, 4 * kGiB), 1);
  EXPECT_EQ(WorkersFor(2, 64 * kGiB, 4 * kGiB), 2);
  EXPECT_EQ(WorkersFor(8, 64 * kGiB, 4 * kGiB), 2);
  EXPECT_EQ(WorkersFor(16, 64 * kGiB, 4 * kGiB), 4);
  EXPECT_EQ(WorkersFor(64, 256 * kGiB, 4 * kGiB), 16);
  EXPECT_EQ(WorkersFor(64, 64 * kGiB, 4 * kGiB), 9);  // 7 GiB each
  EXPECT_EQ(WorkersFor(64, 64 * kGiB, 30 * kGiB), 2);
  EXPECT_EQ(WorkersFor(64, 1 * kGiB, 4 * kGiB), 2);  // as on small machines
  EXPECT_EQ(WorkersFor(64, 64 * kGiB, std::numeric_limits<int64_t>::max()), 2);
}

}  // namespace
}  // namespace tessera
