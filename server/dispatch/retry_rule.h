// What follows from a failed attempt: another one, when, or the end of the task.
//
// What a worker reports speaks against the task, and so does an attempt that stalls. A worker that leaves, or drains,
// says nothing about its task. One that falls silent does if its machine lives on, for then it was the worker's process
// that ended, or hung: a worker on that machine (same host, same boot) has been seen since. A machine that vanished,
// such as one that was taken away, says nothing, however often; that it came back is seen when the task is next lost.
#ifndef TESSERA_SERVER_DISPATCH_RETRY_RULE_H_
#define TESSERA_SERVER_DISPATCH_RETRY_RULE_H_

#include <functional>
#include <string>

#include "server/dispatch/job.h"
#include "server/dispatch/lease_table.h"

namespace tessera {

struct RetryOptions {
  int max_transient = 4;       // attempts that may fail for a reason that may pass
  int max_memory = 2;          // attempts that may run out of memory, each on another worker where there is one
  int max_expired_leases = 3;  // workers that may fall silent on machines that live on before the task counts as poison
  double first_delay_s = 1;    // back-off: doubles with every transient failure
  double max_delay_s = 60;
};

struct RetryVerdict {
  bool final = false;   // the task has failed
  double delay_s = 0;   // else: not again before
  TaskFailure failure;  // as it is to be recorded
};

// `task`: its attempts before this one's end; the current attempt has just ended with `failure`.
RetryVerdict JudgeFailure(const JobTask& task, const TaskFailure& failure, const RetryOptions& options);
// The same for one that ended in silence. `lives`: whether a worker on that machine is there now.
RetryVerdict JudgeSilence(const JobTask& task, const std::function<bool(const std::string& machine)>& lives,
                          const RetryOptions& options);

// How long a task on `threads` may show no progress before its attempt is ended, though its worker's heartbeats go on:
// `stall_s`, or ten times what it is predicted to take.
double StallLimit_s(const PlannedTask& plan, int threads, double stall_s);
// The failure of an attempt that showed none for longer than `limit_s`.
TaskFailure StallOf(const LeaseState& lease, double limit_s);

// Whether `worker` ran out of memory on this task before.
bool RanOutOfMemory(const JobTask& task, const std::string& worker);

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPATCH_RETRY_RULE_H_
