// Decides after a failed attempt: retry after a delay, or permanent failure of the task.
//
// The error class decides whether a failure counts against the task, the worker or storage (RuleOf).
// - Failures of a worker do not count against tasks if others completed its failed tasks (worker_evidence.h).
// - A stalled attempt counts against its task. A worker that unregisters or drains does not.
// - A worker that falls silent counts against its task if another worker on its machine (same host, boot and
//   allocation) called since, because then only the process ended or hung. A silent machine does not count.
// - A worker that has not called since the coordinator started does not count.
#pragma once

#include <functional>
#include <string>

#include "server/leases/lease_table.h"
#include "server/ledger/job.h"

namespace tessera {

struct RetryOptions {
  int max_transient = 4;       // failed or stalled attempts
  int max_memory = 2;          // attempts out of memory, on different workers if possible
  int max_input = 2;           // workers that report wrong input; attempts if there is one worker
  int max_expired_leases = 3;  // workers that fall silent on live machines; then the task is poison
  int max_remakes = 5;         // times that a lost result is recomputed
  double first_delay_s = 1;    // doubles with every failure of the same kind
  double max_delay_s = 60;
  int max_strikes = 2;   // tasks failed here and completed by others before suspension
  double suspend_s = 5;  // first suspension; doubles each time
  double max_suspend_s = 600;
};

// What a failure counts against. kNothing: nothing.
enum class CountsAgainst { kNothing, kTask, kWorker, kStorage };

struct RetryRule {
  CountsAgainst counts_against = CountsAgainst::kTask;
  int limit = 0;         // failures of this class that end the task; 0: no limit
  bool delays = false;   // the next attempt waits, twice as long each time
  bool strikes = false;  // counts against the worker if another one completes the task
};

RetryRule RuleOf(ErrorClass error_class, const RetryOptions& options);

// Evidence about the workers that failed a task.
struct OtherWorkers {
  std::function<bool(const std::string& worker)> ignored = {};  // whether its failures are ignored; may be empty
  bool alone = true;                                            // no other worker can run the task
};

struct RetryDecision {
  bool final = false;   // the task failed permanently
  double delay_s = 0;   // else: delay of the next attempt
  TaskFailure failure;  // to be recorded
};

// `failure`: of the last attempt of `task`.
RetryDecision DecideAfterFailure(const JobTask& task, const TaskFailure& failure, const RetryOptions& options,
                                 const OtherWorkers& others = {});
// The same for an expired lease. `has_called`: whether the worker called since the coordinator started. `lives`:
// whether a worker on that machine is active now.
RetryDecision DecideAfterExpiry(const JobTask& task, bool has_called,
                                const std::function<bool(const std::string& machine)>& lives,
                                const RetryOptions& options);

// Time without progress after which an attempt is ended despite heartbeats: `stall_s` or ten times the predicted time
// on `threads`, whichever is longer.
double StallLimit_s(const PlannedTask& plan, int threads, double stall_s);
// The failure of an attempt without progress for `limit_s`.
TaskFailure StallOf(const LeaseState& lease, double limit_s);

}  // namespace tessera
