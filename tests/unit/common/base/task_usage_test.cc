#include "common/base/task_usage.h"

#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <memory>
#include <vector>

namespace tessera {
namespace {

constexpr int64_t kMiB = int64_t{1} << 20;

// Allocates memory and writes every page, so that it is resident.
int64_t PeakWith(int64_t bytes) {
  const TaskUsageMeter meter;
  std::vector<char> block(bytes);
  for (size_t i = 0; i < block.size(); i += 1024) block[i] = static_cast<char>(i);
  volatile char sink = block[block.size() / 2];
  (void)sink;
  return meter.Read().peak_bytes;
}

TEST(TaskUsageTest, PeakExcludesEarlierTasks) {
  const int64_t large = PeakWith(256 * kMiB);
  EXPECT_GE(large, 256 * kMiB);
  const int64_t small = PeakWith(32 * kMiB);
  if (std::ofstream("/proc/self/clear_refs").good()) {
    EXPECT_GE(small, 32 * kMiB);
    EXPECT_LT(small, large - 200 * kMiB);
  } else {
    EXPECT_EQ(small, 0) << "a peak that cannot be set back is not known";
  }
}

TEST(TaskUsageTest, PeakExcludesMemoryRetainedByEarlierTasks) {
  const int64_t before = PeakWith(32 * kMiB);
  std::vector<char> kept(200 * kMiB);
  for (size_t i = 0; i < kept.size(); i += 1024) kept[i] = 1;
  const int64_t after = PeakWith(32 * kMiB);
  if (std::ofstream("/proc/self/clear_refs").good()) {
    EXPECT_GE(after, 32 * kMiB);
    EXPECT_LT(after, before + 50 * kMiB);
  }
}

TEST(TaskUsageTest, CountsProcessorTimeNotWallTime) {
  const TaskUsageMeter meter;
  volatile double x = 1;
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  double first = 0;
  // Run until 0.1 s of processor time is used, independent of the machine's load.
  while ((first = meter.Read().core_seconds) < 0.1 && std::chrono::steady_clock::now() < until) {
    for (int i = 0; i < 100000; ++i) x = x * 1.0000001;
  }
  EXPECT_GE(first, 0.1);
  EXPECT_GE(meter.Read().threads, 1);
}

TEST(TaskUsageTest, PeakIsZeroWhenNotMeasured) {
  const TaskUsageMeter meter(/*with_peak=*/false);
  std::vector<char> block(64 * kMiB);
  for (size_t i = 0; i < block.size(); i += 1024) block[i] = static_cast<char>(i);
  EXPECT_EQ(meter.Read().peak_bytes, 0);
  EXPECT_GE(meter.Read().threads, 1);
}

TEST(PeakSamplingTest, FirstTaskOfAKindIsDueThenOnePerTenSeconds) {
  PeakSampling sampling;
  const PeakSampling::Clock::time_point start;
  const auto after = [&](int seconds) { return start + std::chrono::seconds(seconds); };
  EXPECT_TRUE(sampling.IsDue("measure", after(0)));
  EXPECT_FALSE(sampling.IsDue("measure", after(1)));
  EXPECT_TRUE(sampling.IsDue("solve", after(1))) << "each kind has its own";
  EXPECT_FALSE(sampling.IsDue("measure", after(9)));
  EXPECT_TRUE(sampling.IsDue("measure", after(10)));
  EXPECT_FALSE(sampling.IsDue("measure", after(19))) << "counted from the last that was measured";
  EXPECT_TRUE(sampling.IsDue("measure", after(20)));
}

}  // namespace
}  // namespace tessera
