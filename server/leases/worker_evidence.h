// Which workers are to be trusted with tasks, by what they and others made of them.
//
// A worker whose scratch folder is unusable says so itself and is set aside at once. One that fails tasks which others
// then do is set aside for that. Either gets a task again after some time; if that goes wrong too, it waits twice as
// long, and a task that it does clears it. It lasts as long as the worker is known; nothing of it is stored.
#ifndef TESSERA_SERVER_LEASES_WORKER_EVIDENCE_H_
#define TESSERA_SERVER_LEASES_WORKER_EVIDENCE_H_

#include <cstdint>
#include <string>
#include <vector>

#include "server/leases/lease_table.h"
#include "server/leases/retry_rule.h"

namespace tessera {

// A worker that was set aside, to be told.
struct SetAsideWorker {
  std::string worker;
  std::string reason;
  double for_s = 0;
};

// Whether the worker gets no tasks at `now_us` (Clock::MonotonicUs).
bool IsSetAside(const WorkerState& worker, int64_t now_us);

// Whether the worker may be given the task: not if it failed it and another one that is there, and not set aside, has
// not yet.
bool MayTry(const JobTask& task, const std::string& worker, const LeaseTable& leases, int64_t now_us);

// What JudgeFailure needs to know about the workers of `task`, whose last attempt has just ended.
Witnesses WitnessesOf(const JobTask& task, const LeaseTable& leases, const RetryOptions& options, int64_t now_us);

// Notes how the last attempt of the task ended. Gives the workers that are set aside for it.
std::vector<SetAsideWorker> NoteFailure(const JobTask& task, const TaskFailure& failure, const RetryOptions& options,
                                        int64_t now_us, LeaseTable& leases);
std::vector<SetAsideWorker> NoteSuccess(const JobTask& task, const std::string& worker, const RetryOptions& options,
                                        int64_t now_us, LeaseTable& leases);

}  // namespace tessera

#endif  // TESSERA_SERVER_LEASES_WORKER_EVIDENCE_H_
