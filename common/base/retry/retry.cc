#include "common/base/retry/retry.h"

#include <algorithm>
#include <chrono>
#include <thread>

#include "common/base/refusal.h"

namespace tessera {
namespace {

constexpr double kMaxServerDelay_s = 60;

}  // namespace

Sleeper RealSleeper() {
  return [](double seconds) {
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
    return true;
  };
}

double Backoff::NextDelay() {
  const double delay = std::min(next_s_, policy_.max_delay_s);
  next_s_ = std::min(next_s_ * policy_.factor, policy_.max_delay_s);
  return delay * (1.0 + policy_.jitter * random_.Uniform(-1.0, 1.0));
}

double Backoff::NextDelay(const Status& error) {
  return std::max(NextDelay(), std::min(RetryDelayOf(error), kMaxServerDelay_s));
}

bool IsTransient(const Status& status, Idempotency idempotency) {
  switch (status.code()) {
    case absl::StatusCode::kUnavailable:
      return true;
    case absl::StatusCode::kDeadlineExceeded:
    case absl::StatusCode::kAborted:
    case absl::StatusCode::kUnknown:
    case absl::StatusCode::kInternal:
      return idempotency == Idempotency::kIdempotent;
    case absl::StatusCode::kResourceExhausted:
      return RefusalOf(status) == Refusal::kLimit && RetryDelayOf(status) > 0;
    default:
      return false;
  }
}

Status Retry(const RetryPolicy& policy, Idempotency idempotency, const Sleeper& sleeper,
             const std::function<Status()>& call) {
  Backoff backoff(policy);
  for (int attempt = 1;; ++attempt) {
    const Status status = call();
    if (status.ok() || !IsTransient(status, idempotency)) return status;
    if (policy.max_attempts > 0 && attempt >= policy.max_attempts) return status;
    if (!sleeper(backoff.NextDelay(status)))
      return absl::CancelledError("cancelled while waiting for the next attempt");
  }
}

}  // namespace tessera
