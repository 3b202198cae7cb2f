#include "server/leases/worker_evidence.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace tessera {
namespace {

// Whether the task or the worker caused the failure, not storage or the network.
bool Failed(const Attempt& attempt) {
  if (attempt.lease_expired || attempt.failure->error_class == ErrorClass::kNone) return false;
  const RetryRule rule = RuleOf(attempt.failure->error_class, {});
  return rule.counts_against == CountsAgainst::kTask || rule.strikes;
}

// Workers call about every second, both while running a task and while waiting.
constexpr int64_t kHeardLately_us = 15'000'000;

bool IsThere(const WorkerState& worker, int64_t now_us) {
  return !IsSuspended(worker, now_us) && now_us - worker.last_seen_us <= kHeardLately_us;
}

SuspendedWorker Suspend(const std::string& name, const std::string& reason, const RetryOptions& options, int64_t now_us,
                        WorkerState& worker) {
  const double for_s = std::min(options.max_suspend_s, options.suspend_s * std::ldexp(1.0, worker.times_suspended++));
  worker.suspended_reason = reason;
  worker.suspended_until_us = now_us + Micros(for_s);
  return {name, reason, for_s};
}

}  // namespace

bool IsSuspended(const WorkerState& worker, int64_t now_us) { return worker.suspended_until_us > now_us; }

bool MayTry(const JobTask& task, const std::string& worker, const LeaseTable& leases, int64_t now_us) {
  const auto failed = [&](const std::string& name) {
    return std::any_of(task.attempts.begin(), task.attempts.end(),
                       [&](const Attempt& attempt) { return attempt.worker == name && Failed(attempt); });
  };
  if (task.attempts.empty() || !failed(worker)) return true;
  return std::none_of(leases.workers().begin(), leases.workers().end(), [&](const auto& other) {
    return other.first != worker && IsThere(other.second, now_us) && !failed(other.first);
  });
}

OtherWorkers OtherWorkersOf(const JobTask& task, const LeaseTable& leases, const RetryOptions& options,
                            int64_t now_us) {
  OtherWorkers others;
  others.ignored = [&leases, &options](const std::string& name) {
    const auto found = leases.workers().find(name);
    return found != leases.workers().end() && found->second.strikes >= options.max_strikes;
  };
  others.alone = std::none_of(leases.workers().begin(), leases.workers().end(), [&](const auto& other) {
    return other.first != task.worker() && IsThere(other.second, now_us);
  });
  return others;
}

std::vector<SuspendedWorker> NoteFailure(const JobTask& task, const TaskFailure& failure, const RetryOptions& options,
                                         int64_t now_us, LeaseTable& leases) {
  WorkerState* const worker = leases.FindWorker(task.worker());
  if (worker == nullptr) return {};
  const RetryRule rule = RuleOf(failure.error_class, options);
  if (failure.error_class == ErrorClass::kScratch) {
    return {Suspend(task.worker(), failure.message, options, now_us, *worker)};
  }
  // It failed again after a suspension.
  if (rule.strikes && worker->strikes >= options.max_strikes) {
    return {Suspend(task.worker(), worker->suspended_reason, options, now_us, *worker)};
  }
  return {};
}

std::vector<SuspendedWorker> NoteSuccess(const JobTask& task, const std::string& name, const RetryOptions& options,
                                         int64_t now_us, LeaseTable& leases) {
  if (WorkerState* const worker = leases.FindWorker(name)) {
    worker->strikes = worker->times_suspended = 0;
    worker->suspended_until_us = 0;
    worker->suspended_reason.clear();
  }
  std::vector<SuspendedWorker> suspended;
  std::set<std::string> struck = {name};
  for (const Attempt& attempt : task.attempts) {
    const ErrorClass error_class = attempt.failure->error_class;
    if (attempt.lease_expired || error_class == ErrorClass::kNone || !RuleOf(error_class, options).strikes) continue;
    WorkerState* const other = leases.FindWorker(attempt.worker);
    if (other == nullptr || !struck.insert(attempt.worker).second) continue;
    if (++other->strikes < options.max_strikes || IsSuspended(*other, now_us)) continue;
    suspended.push_back(Suspend(
        attempt.worker,
        "it failed tasks that other workers completed, the last '" + task.plan.name + "': " + attempt.failure->message,
        options, now_us, *other));
  }
  return suspended;
}

}  // namespace tessera
