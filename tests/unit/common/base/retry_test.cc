#include "common/base/retry/retry.h"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

#include "common/base/refusal.h"

namespace tessera {
namespace {

// Records the delays without waiting.
struct RecordedSleep {
  std::vector<double> delays;
  int broken_off_after = -1;  // waits; negative: never
  Sleeper sleeper() {
    return [this](double seconds) {
      delays.push_back(seconds);
      return broken_off_after < 0 || static_cast<int>(delays.size()) < broken_off_after;
    };
  }
};

RetryPolicy Policy(int attempts) {
  RetryPolicy policy;
  policy.max_attempts = attempts;
  policy.first_delay_s = 1.0;
  policy.max_delay_s = 5.0;
  policy.jitter = 0.0;
  return policy;
}

TEST(RetryTest, StopsAtTheFirstSuccess) {
  RecordedSleep sleep;
  int calls = 0;
  const Status status = Retry(Policy(10), Idempotency::kOnce, sleep.sleeper(),
                              [&] { return ++calls < 3 ? absl::UnavailableError("away") : absl::OkStatus(); });
  EXPECT_TRUE(status.ok());
  EXPECT_EQ(calls, 3);
  EXPECT_EQ(sleep.delays, (std::vector<double>{1.0, 2.0}));
}

TEST(RetryTest, DelaysGrowToMaximumAndAttemptsAreLimited) {
  RecordedSleep sleep;
  int calls = 0;
  const Status status = Retry(Policy(6), Idempotency::kIdempotent, sleep.sleeper(), [&] {
    ++calls;
    return absl::DeadlineExceededError("slow");
  });
  EXPECT_EQ(status.code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_EQ(calls, 6);
  EXPECT_EQ(sleep.delays, (std::vector<double>{1.0, 2.0, 4.0, 5.0, 5.0}));
}

TEST(RetryTest, AmbiguousErrorsAreRetriedOnlyIfIdempotent) {
  for (const Status& doubtful : {absl::DeadlineExceededError(""), absl::UnknownError(""), absl::InternalError("")}) {
    EXPECT_TRUE(IsTransient(doubtful, Idempotency::kIdempotent));
    EXPECT_FALSE(IsTransient(doubtful, Idempotency::kOnce));
  }
}

TEST(RetryTest, PermanentErrorsAreNotRetried) {
  for (const Status& fatal :
       {absl::InvalidArgumentError(""), absl::NotFoundError(""), absl::FailedPreconditionError(""),
        absl::DataLossError(""), absl::CancelledError(""), absl::ResourceExhaustedError("")}) {
    RecordedSleep sleep;
    int calls = 0;
    const Status status = Retry(Policy(0), Idempotency::kIdempotent, sleep.sleeper(), [&] {
      ++calls;
      return fatal;
    });
    EXPECT_EQ(status, fatal);
    EXPECT_EQ(calls, 1);
  }
}

// A call that reached a limit was not executed; the server may send a retry delay.
TEST(RetryTest, RespectsTheServersRetryDelay) {
  const Status limit = LimitError({"calls", 2, "--max"}, "wait");
  EXPECT_FALSE(IsTransient(limit, Idempotency::kIdempotent)) << "nobody knows when";
  for (const auto& [told_s, waited_s] : {std::pair(0.2, 1.0), std::pair(3.5, 3.5), std::pair(1e9, 60.0)}) {
    for (const Status& error : {limit, absl::UnavailableError("away")}) {
      RecordedSleep sleep;
      int calls = 0;
      EXPECT_TRUE(Retry(Policy(3), Idempotency::kOnce, sleep.sleeper(), [&] {
                    return ++calls < 2 ? RetryAfter(error, told_s) : absl::OkStatus();
                  }).ok());
      EXPECT_EQ(sleep.delays, std::vector<double>{waited_s});
    }
  }
}

TEST(RetryTest, CancelledSleepEndsRetries) {
  RecordedSleep sleep;
  sleep.broken_off_after = 4;
  int calls = 0;
  const Status status = Retry(Policy(0), Idempotency::kOnce, sleep.sleeper(), [&] {
    ++calls;
    return absl::UnavailableError("away");
  });
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(calls, 4);
}

TEST(BackoffTest, JitterIsBoundedAndDependsOnSeed) {
  RetryPolicy policy = Policy(0);
  policy.jitter = 0.2;
  policy.seed = 1;
  Backoff one(policy);
  policy.seed = 2;
  Backoff two(policy);
  bool differs = false;
  double expected = 1.0;
  for (int i = 0; i < 20; ++i) {
    const double a = one.NextDelay();
    const double b = two.NextDelay();
    differs |= a != b;
    EXPECT_GE(a, 0.8 * expected);
    EXPECT_LE(a, 1.2 * expected);
    expected = std::min(2 * expected, 5.0);
  }
  EXPECT_TRUE(differs);
  one.Reset();
  EXPECT_LE(one.NextDelay(), 1.2);
}

}  // namespace
}  // namespace tessera
