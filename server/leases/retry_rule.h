// What follows from a failed attempt: another one, when, or the end of the task; and against whom it counts.
//
// What a worker reports is laid at the task, at the worker or at storage by its class (RuleOf); status codes mean
// nothing here. Failures of a worker that others have proved wrong do not count against tasks (worker_evidence.h). An
// attempt that stalls speaks against its task. A worker that leaves, or drains, says nothing about its task. One that
// falls silent does if its machine lives on, for then it was the worker's process that ended, or hung: a worker on that
// machine (same host, same boot) has been seen since. A machine that vanished, such as one that was taken away, says
// nothing, however often; that it came back is seen when the task is next lost. Nor does a worker that was not heard of
// since the coordinator began anew: what became of it, nobody saw.
#ifndef TESSERA_SERVER_LEASES_RETRY_RULE_H_
#define TESSERA_SERVER_LEASES_RETRY_RULE_H_

#include <functional>
#include <string>

#include "server/leases/lease_table.h"
#include "server/ledger/job.h"

namespace tessera {

struct RetryOptions {
  int max_transient = 4;       // attempts that may fail by a worker's fault, or stall
  int max_memory = 2;          // attempts that may run out of memory, each on another worker where there is one
  int max_input = 2;           // workers that say that the input is wrong; of one that is alone, its attempts
  int max_expired_leases = 3;  // workers that may fall silent on machines that live on before the task counts as poison
  int max_remakes = 5;         // times that a task's result may be lost and made again
  double first_delay_s = 1;    // back-off: doubles with every failure of the kind
  double max_delay_s = 60;
  int max_strikes = 2;   // tasks that a worker failed and others did, before it is suspended
  double suspend_s = 5;  // for how long, the first time; doubles
  double max_suspend_s = 600;
};

// Against whom a failure counts.
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
  std::function<bool(const std::string& worker)> doubted = {};  // its word does not count; may be empty: nobody's
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

#endif  // TESSERA_SERVER_LEASES_RETRY_RULE_H_
