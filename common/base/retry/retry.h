// Retries of calls after transient errors, with exponential back-off.
#pragma once

#include <cstdint>
#include <functional>

#include "common/base/random.h"
#include "common/base/status.h"

namespace tessera {

// Whether a call may be repeated that the server may already have executed.
enum class Idempotency { kIdempotent, kOnce };

// Waits `seconds`; returns false if the wait was cancelled. Passed in, so that tests need not wait.
using Sleeper = std::function<bool(double seconds)>;

// Sleeps the calling thread; never cancelled.
Sleeper RealSleeper();

struct RetryPolicy {
  int max_attempts = 5;  // 0: no limit
  double first_delay_s = 0.1;
  double max_delay_s = 5.0;
  double factor = 2.0;
  double jitter = 0.2;  // random share by which a delay varies, so that many clients do not retry at once
  uint64_t seed = 0;    // of the jitter
};

// The delays between attempts: each is `factor` times the one before, up to `max_delay_s`. Not thread-safe.
class Backoff {
 public:
  explicit Backoff(const RetryPolicy& policy) : policy_(policy), random_(policy.seed), next_s_(policy.first_delay_s) {}
  double NextDelay();
  // At least the delay that the server sent with its error (RetryDelayOf), up to 60 s.
  double NextDelay(const Status& error);
  // Starts again at `first_delay_s`; call it after a success.
  void Reset() { next_s_ = policy_.first_delay_s; }

 private:
  RetryPolicy policy_;
  Random random_;
  double next_s_;
};

// Whether a call with this error may be retried. Always: UNAVAILABLE, and Refusal::kLimit with a retry delay, because
// the server did not execute the call. Only if idempotent, because the server may have executed it: DEADLINE_EXCEEDED,
// ABORTED, UNKNOWN and INTERNAL (a broken stream).
bool IsTransient(const Status& status, Idempotency idempotency);

// Calls `call` until it succeeds, fails permanently, the attempts are used up, or the sleeper is cancelled (CANCELLED).
// `call` must create a new context, deadline and request stream for each attempt.
Status Retry(const RetryPolicy& policy, Idempotency idempotency, const Sleeper& sleeper,
             const std::function<Status()>& call);

}  // namespace tessera
