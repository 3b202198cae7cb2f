#include "server/leases/retry_rule.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace tessera {

RetryRule RuleOf(ErrorClass error_class, const RetryOptions& options) {
  switch (error_class) {
    //                          counts against, limit, delays, strikes
    case ErrorClass::kInput:
      return {CountsAgainst::kTask, options.max_input, false, true};
    case ErrorClass::kMemory:
      return {CountsAgainst::kTask, options.max_memory, false, false};
    case ErrorClass::kPoison:
      return {CountsAgainst::kTask, 1, false, false};
    case ErrorClass::kNone:
    case ErrorClass::kTransient:
    case ErrorClass::kInternal:
      return {CountsAgainst::kTask, options.max_transient, true, true};
    case ErrorClass::kPreempted:
      return {CountsAgainst::kNothing, 0, false, false};
    case ErrorClass::kLostInput:  // not confirmed; Recovery handles confirmed losses
      return {CountsAgainst::kWorker, 0, true, true};
    case ErrorClass::kScratch:
      return {CountsAgainst::kWorker, 0, false, false};
    case ErrorClass::kPeer:
      return {CountsAgainst::kNothing, 0, true, false};
    case ErrorClass::kStorage:
      return {CountsAgainst::kStorage, 0, true, false};
  }
  return {CountsAgainst::kTask, options.max_transient, true, true};
}

RetryDecision DecideAfterFailure(const JobTask& task, const TaskFailure& failure, const RetryOptions& options,
                                 const OtherWorkers& others) {
  RetryDecision decision;
  decision.failure = failure;
  if (failure.error_class == ErrorClass::kNone) decision.failure.error_class = ErrorClass::kInternal;
  const bool is_input = failure.error_class == ErrorClass::kInput;
  const RetryRule rule = RuleOf(decision.failure.error_class, options);
  // Stalls and internal errors share one limit, because the same fault can cause both.
  const auto kind = [](ErrorClass of) { return of == ErrorClass::kTransient ? ErrorClass::kInternal : of; };
  int times = 1, counted = 1;  // with this one
  std::set<std::string> workers = {task.worker()};
  for (const Attempt& attempt : task.attempts) {
    if (&attempt == &task.attempts.back() || attempt.lease_expired) continue;
    if (kind(attempt.failure->error_class) != kind(decision.failure.error_class)) continue;
    ++times;
    if (others.ignored && others.ignored(attempt.worker)) continue;
    ++counted;
    workers.insert(attempt.worker);
  }
  if (is_input && !others.alone) counted = static_cast<int>(workers.size());
  const bool ignored = others.ignored && others.ignored(task.worker());
  decision.final = rule.limit > 0 && !ignored && counted >= rule.limit;
  if (rule.delays || (is_input && others.alone)) {
    decision.delay_s = std::min(options.max_delay_s, options.first_delay_s * std::ldexp(1.0, times - 1));
  }
  return decision;
}

RetryDecision DecideAfterExpiry(const JobTask& task, bool has_called,
                                const std::function<bool(const std::string& machine)>& lives,
                                const RetryOptions& options) {
  RetryDecision decision;
  if (!has_called) {
    decision.failure = {ErrorClass::kPreempted,
                        "lease expired: " + task.worker() + " did not call since the coordinator restarted"};
    return decision;
  }
  const auto speaks = [&, current = &task.attempts.back()](const Attempt& attempt) {
    const bool fell_silent = attempt.lease_expired && attempt.failure->error_class != ErrorClass::kPreempted;
    return (fell_silent || &attempt == current) && lives(attempt.machine);
  };
  const int deaths = static_cast<int>(std::count_if(task.attempts.begin(), task.attempts.end(), speaks));
  decision.final = deaths >= options.max_expired_leases;
  decision.failure = {decision.final ? ErrorClass::kPoison : ErrorClass::kTransient,
                      "lease expired: " + task.worker() + " fell silent"};
  if (decision.final) {
    decision.failure.message +=
        " during '" + task.plan.name + "': the task lost " + std::to_string(deaths) + " workers on live machines";
  }
  return decision;
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

}  // namespace tessera
