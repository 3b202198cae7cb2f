#include "common/base/task_usage.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

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

// Page faults of writing 16 MiB of new memory, twice, in a new process that may keep `kept_bytes`: those of the second.
int64_t FaultsOfReuse(int64_t kept_bytes) {
  int ends[2];
  if (pipe(ends) != 0) return -1;
  if (const pid_t child = fork(); child == 0) {
    KeepFreedMemory(kept_bytes);
    int64_t faults[2] = {0, 0};
    for (int64_t& of : faults) {
      rusage before = {}, after = {};
      getrusage(RUSAGE_SELF, &before);
      std::vector<char> block(16 * kMiB);
      for (size_t i = 0; i < block.size(); i += 1024) block[i] = static_cast<char>(i + 1);
      getrusage(RUSAGE_SELF, &after);
      of = after.ru_minflt - before.ru_minflt;
    }
    _exit(write(ends[1], &faults[1], sizeof(faults[1])) == sizeof(faults[1]) ? 0 : 1);
  } else {
    int64_t faults = -1;
    if (read(ends[0], &faults, sizeof(faults)) != sizeof(faults)) faults = -1;
    waitpid(child, nullptr, 0);
    close(ends[0]);
    close(ends[1]);
    return faults;
  }
}

TEST(KeepFreedMemory, FreedBlocksAreUsedAgainWithoutPageFaults) {
  const int64_t kept = FaultsOfReuse(64 * kMiB), given_back = FaultsOfReuse(0);
  ASSERT_GE(kept, 0);
  EXPECT_LT(kept, 100);
  EXPECT_GT(given_back, 1000) << "the bound holds";
}

TEST(PeakSamplingTest, MeasuresOneTaskOfAKindInTenMinutes) {
  PeakSampling sampling;
  const PeakSampling::Clock::time_point start;
  const auto after = [&](int seconds) { return start + std::chrono::seconds(seconds); };
  EXPECT_TRUE(sampling.IsDue("measure", after(0)));
  EXPECT_FALSE(sampling.IsDue("measure", after(1)));
  EXPECT_TRUE(sampling.IsDue("solve", after(1))) << "each kind has its own";
  EXPECT_FALSE(sampling.IsDue("measure", after(599)));
  EXPECT_TRUE(sampling.IsDue("measure", after(700)));
  EXPECT_FALSE(sampling.IsDue("measure", after(1299))) << "counted from the last that was measured";
  EXPECT_TRUE(sampling.IsDue("measure", after(1300)));
}

}  // namespace
}  // namespace tessera
