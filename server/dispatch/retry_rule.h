// What follows from a failed attempt: another one, when, or the end of the task.
#ifndef TESSERA_SERVER_DISPATCH_RETRY_RULE_H_
#define TESSERA_SERVER_DISPATCH_RETRY_RULE_H_

#include "server/dispatch/job.h"

namespace tessera {

struct RetryOptions {
  int max_transient = 4;       // attempts that may fail for a reason that may pass
  int max_memory = 2;          // attempts that may run out of memory, each on another worker where there is one
  int max_expired_leases = 3;  // workers that may fall silent over one task before it counts as poison
  int max_attempts = 20;       // of any outcome
  double first_delay_s = 1;    // back-off: doubles with every transient failure
  double max_delay_s = 60;
};

struct RetryVerdict {
  bool final = false;   // the task has failed
  double delay_s = 0;   // else: not again before
  TaskFailure failure;  // as it is to be recorded
};

// `task`: its attempts before this one's end; the current attempt has just ended with `failure` or, if `lease_expired`,
// in silence.
RetryVerdict JudgeFailure(const JobTask& task, const TaskFailure& failure, bool lease_expired,
                          const RetryOptions& options);

// Whether `worker` ran out of memory on this task before.
bool RanOutOfMemory(const JobTask& task, const std::string& worker);

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPATCH_RETRY_RULE_H_
