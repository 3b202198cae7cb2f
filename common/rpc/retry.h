// Calls that are tried again when the network or the other side fails them for a while.
#ifndef TESSERA_COMMON_RPC_RETRY_H_
#define TESSERA_COMMON_RPC_RETRY_H_

#include <cstdint>
#include <functional>

#include "common/base/random.h"
#include "common/base/status.h"

namespace tessera {

// Whether a call that may have been carried out already may be sent again.
enum class Idempotency { kIdempotent, kOnce };

// Waits `seconds`; false if the wait was broken off because nobody wants the result any more. Passed in, so that tests
// wait for nothing.
using Sleeper = std::function<bool(double seconds)>;

// Sleeps for real and is never broken off.
Sleeper RealSleeper();

struct RetryPolicy {
  int max_attempts = 5;  // 0: for ever
  double first_delay_s = 0.1;
  double max_delay_s = 5.0;
  double factor = 2.0;
  double jitter = 0.2;  // the delay varies by this share of itself, so that many clients do not come at once
  uint64_t seed = 0;    // of the jitter
};

// The delays between attempts: growing by the factor up to the largest. Not thread-safe.
class Backoff {
 public:
  explicit Backoff(const RetryPolicy& policy) : policy_(policy), random_(policy.seed), next_s_(policy.first_delay_s) {}
  double NextDelay();
  // No less than the other side told with its error, up to a minute.
  double NextDelay(const Status& error);
  // After a success: starts small again.
  void Reset() { next_s_ = policy_.first_delay_s; }

 private:
  RetryPolicy policy_;
  Random random_;
  double next_s_;
};

// Whether an error may go away by itself. UNAVAILABLE does and says that nothing was lost on the way, and so does a
// limit (Refusal::kLimit) where it was told when to try again; what may have been carried out (DEADLINE_EXCEEDED,
// ABORTED, UNKNOWN, INTERNAL of a broken stream) only counts for idempotent calls.
bool IsTransient(const Status& status, Idempotency idempotency);

// Calls `call` until it succeeds, fails for good, the attempts are used up or the sleeper is broken off (CANCELLED
// then). `call` must make everything that belongs to one attempt (context, deadline, request stream) anew.
Status Retry(const RetryPolicy& policy, Idempotency idempotency, const Sleeper& sleeper,
             const std::function<Status()>& call);

}  // namespace tessera

#endif  // TESSERA_COMMON_RPC_RETRY_H_
