#include "server/dispatch/retry_rule.h"

#include <algorithm>
#include <cmath>

namespace tessera {

RetryVerdict JudgeFailure(const JobTask& task, const TaskFailure& failure, bool lease_expired,
                          const RetryOptions& options) {
  int transient = 0, memory = 0, expired = 0;
  for (const Attempt& attempt : task.attempts) {
    if (attempt.lease_expired) {
      ++expired;
    } else if (attempt.failure.error_class == ErrorClass::kTransient) {
      ++transient;
    } else if (attempt.failure.error_class == ErrorClass::kMemory) {
      ++memory;
    }
  }
  RetryVerdict verdict;
  verdict.failure = failure;
  if (lease_expired) {
    verdict.final = ++expired >= options.max_expired_leases;
    verdict.failure = {verdict.final ? ErrorClass::kPoison : ErrorClass::kTransient,
                       "lease expired: " + task.worker() + " fell silent"};
    if (verdict.final) {
      verdict.failure.message += ", as " + std::to_string(expired - 1) + " before it over '" + task.plan.name + "'";
    }
  } else {
    switch (failure.error_class) {
      case ErrorClass::kInput:
      case ErrorClass::kPoison:
        verdict.final = true;
        break;
      case ErrorClass::kMemory:
        verdict.final = ++memory >= options.max_memory;
        break;
      case ErrorClass::kAborted:
        break;
      case ErrorClass::kNone:
        verdict.failure.error_class = ErrorClass::kTransient;
        [[fallthrough]];
      case ErrorClass::kTransient:
        verdict.final = ++transient >= options.max_transient;
        verdict.delay_s = std::min(options.max_delay_s, options.first_delay_s * std::ldexp(1.0, transient - 1));
        break;
    }
  }
  if (task.attempt() >= options.max_attempts) verdict.final = true;
  return verdict;
}

bool RanOutOfMemory(const JobTask& task, const std::string& worker) {
  return std::any_of(task.attempts.begin(), task.attempts.end(), [&](const Attempt& attempt) {
    return attempt.failure.error_class == ErrorClass::kMemory && attempt.worker == worker;
  });
}

}  // namespace tessera
