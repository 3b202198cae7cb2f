// What follows from a failed attempt: a retry after a delay, or the end of the task.
//
// The error class decides whether a failure counts against the task, the worker or storage (RuleOf).
// - Failures of a worker whose tasks other workers then did do not count against tasks (worker_evidence.h).
// - An attempt that stalls counts against its task. A worker that leaves or drains does not.
// - A worker that falls silent counts against its task if another worker on its machine (same host, same boot) called
//   since: then the worker's process ended or hung. If the whole machine is silent, it does not count.
// - A worker that has not called since the coordinator started does not count: its end was not observed.
#pragma once

#include <functional>
#include <string>

#include "server/leases/lease_table.h"
#include "server/ledger/job.h"

namespace tessera {

struct RetryOptions {
  int max_transient = 4;       // attempts that may fail by a fault of workers, or stall
  int max_memory = 2;          // attempts that may run out of memory, each on another worker where there is one
  int max_input = 2;           // workers that report wrong input; of a single worker, its attempts
  int max_expired_leases = 3;  // workers that may fall silent on live machines; then the task counts as poison
  int max_remakes = 5;         // times that a task's result may be lost and made again
  double first_delay_s = 1;    // back-off: doubles with every failure of the kind
  double max_delay_s = 60;
  int max_strikes = 2;   // tasks that a worker failed and other workers did, until it is suspended
  double suspend_s = 5;  // for how long, the first time; doubles
  double max_suspend_s = 600;
};

// What a failure counts against.
enum class Blame { kNobody, kTask, kWorker, kStorage };

struct RetryRule {
  Blame blame = Blame::kTask;
  int limit = 0;         // attempts that may fail so before the task has failed; 0: any number
  bool delays = false;   // the next attempt waits, longer every time
  bool strikes = false;  // if another worker then does the task, this one was wrong
};

RetryRule RuleOf(ErrorClass error_class, const RetryOptions& options);

// What is known about the workers that failed a task.
struct Witnesses {
  std::function<bool(const std::string& worker)> doubted = {};  // its failures do not count; may be empty: none is
  bool alone = true;                                            // no other worker is there that could do the task
};

struct RetryVerdict {
  bool final = false;   // the task has failed
  double delay_s = 0;   // else: not again before
  TaskFailure failure;  // as it is to be recorded
};

// `task`: its attempts, of which the last has just ended with `failure`.
RetryVerdict JudgeFailure(const JobTask& task, const TaskFailure& failure, const RetryOptions& options,
                          const Witnesses& witnesses = {});
// The same for one that ended in silence. `heard`: whether its worker was, in the coordinator's present life. `lives`:
// whether a worker on that machine is there now.
RetryVerdict JudgeSilence(const JobTask& task, bool heard, const std::function<bool(const std::string& machine)>& lives,
                          const RetryOptions& options);

// How long a task on `threads` may show no progress before its attempt is ended, though its worker's heartbeats go on:
// `stall_s`, or ten times what it is predicted to take.
double StallLimit_s(const PlannedTask& plan, int threads, double stall_s);
// The failure of an attempt that showed none for longer than `limit_s`.
TaskFailure StallOf(const LeaseState& lease, double limit_s);

}  // namespace tessera
