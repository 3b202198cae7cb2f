#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <new>
#include <thread>
#include <vector>

#include "common/base/machine_limits.h"
#include "common/base/parallel.h"
#include "common/base/random.h"
#include "common/base/status.h"

namespace tessera {
namespace {

TEST(InputErrorTest, NamesFileLocationFoundAndExpected) {
  const Status status = InputError("mesh.ply", "line 4", "'elment'", "'element'");
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message(), "mesh.ply: line 4: found 'elment', expected 'element'");
}

TEST(FaultsTest, KeepsEveryFault) {
  Faults faults;
  EXPECT_TRUE(faults.ToStatus().ok());
  faults.Add(absl::OkStatus());
  EXPECT_TRUE(faults.empty());
  faults.Add(absl::NotFoundError("one"));
  faults.Add(absl::NotFoundError("two"));
  EXPECT_EQ(faults.ToStatus().message(), "one\ntwo");
}

TEST(ParallelForTest, VisitsEachIndexOnce) {
  std::vector<std::atomic<int>> visits(1003);
  ParallelFor(1003, 10, [&](int64_t begin, int64_t end) {
    EXPECT_LE(end - begin, 10);
    for (int64_t i = begin; i < end; ++i) ++visits[i];
  });
  for (const auto& count : visits) EXPECT_EQ(count, 1);
  ParallelFor(0, 10, [](int64_t, int64_t) { FAIL(); });
}

TEST(ParallelForTest, VisitsEachIndexOfNestedLoopsOnce) {
  const ThreadLimit limit(4);
  for (int repeat = 0; repeat < 200; ++repeat) {
    std::vector<std::atomic<int>> visits(64 * 16);
    ParallelForEach(64, 1, [&](int64_t i) { ParallelForEach(16, 1, [&](int64_t k) { ++visits[16 * i + k]; }); });
    for (const auto& count : visits) ASSERT_EQ(count, 1) << repeat;
  }
}

TEST(ParallelForTest, RunsOnAsManyThreadsAsAllowed) {
  for (const int threads : {1, 2, 4, 2}) {
    const ThreadLimit limit(threads);
    std::atomic<int> running = 0, most = 0;
    // A thread of the pool may be late, so a loop alone need not reach the limit.
    for (int repeat = 0; repeat < 100 && most < threads; ++repeat) {
      ParallelForEach(8, 1, [&](int64_t) {
        const int now = ++running;
        for (int seen = most; seen < now && !most.compare_exchange_weak(seen, now);) {
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
        --running;
      });
    }
    EXPECT_EQ(most, threads);
  }
}

TEST(ParallelForTest, LoopsOfSeveralCallersShareTheHelpers) {
  for (const int threads : {4, 2}) {
    const ThreadLimit limit(threads);
    std::atomic<int64_t> sum = 0;
    std::atomic<int> running = 0, most = 0;
    {
      std::vector<std::jthread> callers;
      for (int t = 0; t < 4; ++t) {
        callers.emplace_back([&] {
          for (int repeat = 0; repeat < 50; ++repeat) {
            ParallelForEach(8, 1, [&](int64_t i) {
              const int now = ++running;
              for (int seen = most; seen < now && !most.compare_exchange_weak(seen, now);) {
              }
              std::this_thread::sleep_for(std::chrono::microseconds(200));
              sum += i;
              --running;
            });
          }
        });
      }
    }
    EXPECT_EQ(sum, 4 * 50 * 28);
    EXPECT_LE(most, 4 + threads - 1);
  }
}

TEST(ParallelForTest, AnExceptionReachesTheCaller) {
  const ThreadLimit limit(4);
  for (int repeat = 0; repeat < 100; ++repeat) {
    EXPECT_THROW(ParallelForEach(100, 1,
                                 [&](int64_t i) {
                                   if (i % 10 == 3) throw std::bad_alloc();
                                 }),
                 std::bad_alloc);
  }
  std::atomic<int> visits = 0;
  ParallelForEach(100, 1, [&](int64_t) { ++visits; });
  EXPECT_EQ(visits, 100);
}

TEST(ItemsAtOnceTest, AreOneAThreadWithinTheBatchsMemory) {
  for (const int threads : {1, 2, 8, 100}) {
    const ThreadLimit limit(threads);
    for (const double bytes : {1.0, 1e6, 3e7, 1e8, 1e9}) {
      const int items = ItemsAtOnce(bytes);
      EXPECT_GE(items, 1);
      EXPECT_LE(items, threads);
      EXPECT_TRUE(items == 1 || items * bytes <= static_cast<double>(LookaheadLimit_bytes(threads))) << items;
    }
    EXPECT_EQ(ItemsAtOnce(1e9), 1);
    EXPECT_EQ(ItemsAtOnce(1), std::min(ThreadCount(), 64));
  }
}

TEST(ParallelSumTest, DoesNotDependOnThreads) {
  const auto run = [](int threads) {
    ThreadLimit limit(threads);
    return ParallelSum(100000, 7, [](int64_t begin, int64_t end) {
      double sum = 0;
      for (int64_t i = begin; i < end; ++i) sum += 1.0 / (1.0 + static_cast<double>(i));
      return sum;
    });
  };
  EXPECT_EQ(run(1), run(2));
  EXPECT_EQ(run(1), run(0));
}

TEST(RandomTest, SameSeedSameNumbersAndUnitMoments) {
  Random a(7), b(7), c(8);
  EXPECT_EQ(a.Bits(), b.Bits());
  EXPECT_NE(a.Bits(), c.Bits());
  double mean = 0, square = 0;
  for (int i = 0; i < 100000; ++i) {
    const double x = a.Normal();
    mean += x / 100000;
    square += x * x / 100000;
  }
  EXPECT_NEAR(mean, 0, 0.02);
  EXPECT_NEAR(square, 1, 0.02);
}

}  // namespace
}  // namespace tessera
