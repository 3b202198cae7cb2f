#include "server/dispatch/retry_rule.h"

#include <algorithm>
#include <cmath>

namespace tessera {

RetryVerdict JudgeFailure(const JobTask& task, const TaskFailure& failure, const RetryOptions& options) {
  const auto failed_as = [&](ErrorClass error_class) {  // this time included
    return 1 + static_cast<int>(std::count_if(task.attempts.begin(), task.attempts.end(), [&](const Attempt& attempt) {
             return !attempt.lease_expired && attempt.failure.error_class == error_class;
           }));
  };
  RetryVerdict verdict;
  verdict.failure = failure;
  switch (failure.error_class) {
    case ErrorClass::kInput:
    case ErrorClass::kPoison:
      verdict.final = true;
      break;
    case ErrorClass::kMemory:
      verdict.final = failed_as(ErrorClass::kMemory) >= options.max_memory;
      break;
    case ErrorClass::kAborted:
      break;
    case ErrorClass::kNone:
      verdict.failure.error_class = ErrorClass::kTransient;
      [[fallthrough]];
    case ErrorClass::kTransient: {
      const int times = failed_as(ErrorClass::kTransient);
      verdict.final = times >= options.max_transient;
      verdict.delay_s = std::min(options.max_delay_s, options.first_delay_s * std::ldexp(1.0, times - 1));
      break;
    }
  }
  return verdict;
}

RetryVerdict JudgeSilence(const JobTask& task, const std::function<bool(const std::string& machine)>& lives,
                          const RetryOptions& options) {
  const int deaths = static_cast<int>(std::count_if(
      task.attempts.begin(), task.attempts.end(), [&, current = &task.attempts.back()](const Attempt& attempt) {
        return (attempt.lease_expired || &attempt == current) && lives(attempt.machine);
      }));
  RetryVerdict verdict;
  verdict.final = deaths >= options.max_expired_leases;
  verdict.failure = {verdict.final ? ErrorClass::kPoison : ErrorClass::kTransient,
                     "lease expired: " + task.worker() + " fell silent"};
  if (verdict.final) {
    verdict.failure.message += " over '" + task.plan.name + "', one of " + std::to_string(deaths) +
                               " workers that did while their machines live on";
  }
  return verdict;
}

double StallLimit_s(const PlannedTask& plan, int threads, double stall_s) {
  return std::max(stall_s, 10 * plan.cost / threads);
}

TaskFailure StallOf(const LeaseState& lease, double limit_s) {
  return {ErrorClass::kTransient, "stalled: " + lease.worker + " showed no progress for " +
                                      std::to_string(std::lround(limit_s)) + " s, at " +
                                      std::to_string(std::lround(100 * lease.progress)) + " %" +
                                      (lease.stage.empty() ? "" : " (" + lease.stage + ")")};
}

bool RanOutOfMemory(const JobTask& task, const std::string& worker) {
  return std::any_of(task.attempts.begin(), task.attempts.end(), [&](const Attempt& attempt) {
    return attempt.failure.error_class == ErrorClass::kMemory && attempt.worker == worker;
  });
}

}  // namespace tessera
