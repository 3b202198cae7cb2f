#include "common/base/machine_limits.h"

#include <gtest/gtest.h>
#include <sched.h>
#include <sys/resource.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <thread>

namespace tessera {
namespace {

class MachineLimitsTest : public testing::Test {
 protected:
  ~MachineLimitsTest() override { std::filesystem::remove_all(root_); }
  void Write(const std::string& path, const std::string& content) {
    std::filesystem::create_directories(std::filesystem::path(root_ + path).parent_path());
    std::ofstream(root_ + path) << content;
  }
  const std::string root_ = testing::TempDir() + "/" + testing::UnitTest::GetInstance()->current_test_info()->name();
};

TEST_F(MachineLimitsTest, NoControlGroupsMeansNoLimit) {
  EXPECT_EQ(GroupMemoryLimit_bytes(root_), std::numeric_limits<int64_t>::max());
  EXPECT_EQ(GroupCoreLimit(root_), 0);
}

TEST_F(MachineLimitsTest, Version2TakesTheSmallestLimitOfAllAncestors) {
  Write("/proc/self/cgroup", "0::/batch/job\n");
  Write("/sys/fs/cgroup/batch/job/memory.max", "max\n");
  Write("/sys/fs/cgroup/batch/job/cpu.max", "350000 100000\n");
  EXPECT_EQ(GroupMemoryLimit_bytes(root_), std::numeric_limits<int64_t>::max());
  EXPECT_EQ(GroupCoreLimit(root_), 3.5);
  Write("/sys/fs/cgroup/batch/memory.max", "3000000000\n");
  Write("/sys/fs/cgroup/batch/cpu.max", "max 100000\n");
  EXPECT_EQ(GroupMemoryLimit_bytes(root_), 3'000'000'000);
  Write("/sys/fs/cgroup/batch/job/memory.max", "2000000000\n");
  Write("/sys/fs/cgroup/batch/cpu.max", "200000 100000\n");
  EXPECT_EQ(GroupMemoryLimit_bytes(root_), 2'000'000'000);
  EXPECT_EQ(GroupCoreLimit(root_), 2);
}

// In a container the mount point is the folder of the process's group.
TEST_F(MachineLimitsTest, Version1AndContainers) {
  Write("/proc/self/cgroup", "9:name=systemd:/\n4:memory:/docker/abc\n2:cpu,cpuacct:/docker/abc\n0::/\n");
  Write("/sys/fs/cgroup/memory/memory.limit_in_bytes", "1000000000\n");
  Write("/sys/fs/cgroup/cpu/cpu.cfs_quota_us", "-1\n");
  Write("/sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n");
  EXPECT_EQ(GroupMemoryLimit_bytes(root_), 1'000'000'000);
  EXPECT_EQ(GroupCoreLimit(root_), 0);
  Write("/sys/fs/cgroup/memory/docker/abc/memory.limit_in_bytes", "900000000\n");
  Write("/sys/fs/cgroup/cpu/docker/abc/cpu.cfs_quota_us", "150000\n");
  Write("/sys/fs/cgroup/cpu/docker/abc/cpu.cfs_period_us", "100000\n");
  EXPECT_EQ(GroupMemoryLimit_bytes(root_), 900'000'000);
  EXPECT_EQ(GroupCoreLimit(root_), 1.5);
}

TEST_F(MachineLimitsTest, AppliesUserLimitAndAffinityMask) {
  const int64_t all = MemoryLimit_bytes();
  SetMemoryLimit(all / 2);
  EXPECT_EQ(MemoryLimit_bytes(), all / 2);
  SetMemoryLimit(2 * all);
  EXPECT_EQ(MemoryLimit_bytes(), all);
  SetMemoryLimit(0);
  std::thread([] {  // a mask of its own
    cpu_set_t mask;
    ASSERT_EQ(sched_getaffinity(0, sizeof(mask), &mask), 0);
    int first = 0;
    while (!CPU_ISSET(first, &mask)) ++first;
    CPU_ZERO(&mask);
    CPU_SET(first, &mask);
    ASSERT_EQ(sched_setaffinity(0, sizeof(mask), &mask), 0);
    EXPECT_EQ(CoreLimit(), 1);
  })
      .join();
  EXPECT_GE(CoreLimit(), 1);
}

// Each in a process of its own: the first call decides.
TEST(MachineLimitsDeathTest, LookaheadIsASmallShareOfTheMemory) {
  testing::GTEST_FLAG(death_test_style) = "threadsafe";
  const auto lookahead_of = [](int64_t memory) {
    SetMemoryLimit(memory);
    const int64_t first = LookaheadLimit_bytes(2);
    SetMemoryLimit(0);
    return LookaheadLimit_bytes(64) == first ? static_cast<int>(first >> 20) : 255;
  };
  EXPECT_EXIT(std::exit(lookahead_of(int64_t{1} << 30)), testing::ExitedWithCode(32), "");
  EXPECT_EXIT(std::exit(lookahead_of(int64_t{2} << 30)), testing::ExitedWithCode(64), "");
  const auto grows_with_threads = [] {
    const int64_t share = MemoryLimit_bytes() / 32, mib = 1 << 20;
    const auto is = [&](int threads, int64_t most_mib) {
      return LookaheadLimit_bytes(threads) == std::min(share, most_mib * mib);
    };
    return is(1, 256) && is(8, 256) && is(10, 320) && is(64, 2048);
  };
  EXPECT_EXIT(std::exit(grows_with_threads() ? 7 : 1), testing::ExitedWithCode(7), "");
}

TEST(MachineLimits, AppliesResourceLimits) {
  const int64_t before = MemoryLimit_bytes();
  EXPECT_GT(before, 64 << 20);
  rlimit limit = {};
  ASSERT_EQ(getrlimit(RLIMIT_DATA, &limit), 0);
  const rlimit small = {static_cast<rlim_t>(before / 2), limit.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_DATA, &small), 0);
  EXPECT_EQ(MemoryLimit_bytes(), before / 2);
  ASSERT_EQ(setrlimit(RLIMIT_DATA, &limit), 0);
  EXPECT_EQ(MemoryLimit_bytes(), before);
}

}  // namespace
}  // namespace tessera
