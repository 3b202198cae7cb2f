// Jobs and tasks as they are shown: the ledger's state and the progress that workers report.
#pragma once

#include <string>
#include <vector>

#include "server/leases/lease_table.h"
#include "server/ledger/job.h"

namespace tessera {

struct JobStatus {
  JobHeader header;     // its warnings followed by the tasks' own
  int tasks_total = 0;  // known so far
  int tasks_done = 0;
  int tiles_total = 0;
  int tiles_done = 0;       // refined
  double progress = 0;      // in [0, 1], by predicted cost; never goes back
  double eta_s = -1;        // negative: not known
  std::string waiting_for;  // why it makes no progress (WaitingFor)
};

struct TaskStatus {
  std::string name;
  JobTask task;
  double progress = 0;  // of the current attempt
  std::string stage;
};

// A job as its watchers see it.
struct WatchedJob {
  JobStatus job;
  std::vector<TaskStatus> running;
  bool end_waits = false;  // it has ended, but the end is not durable and not shown yet
};

// The numbers of these are those of tessera.v1.
enum class AttemptOutcome { kRunning = 1, kSucceeded = 2, kFailed = 3, kLeaseExpired = 4, kCancelled = 5 };
AttemptOutcome OutcomeOf(const Attempt& attempt);

// One attempt, and the identity of its task.
struct AttemptStatus {
  TaskRef task;
  int number = 0;  // counted from 1
  std::string kind, title;
  int tile = -1;
  Attempt attempt;
};

// Attempts in the order of tasks, then of their numbers.
struct AttemptPage {
  std::vector<AttemptStatus> attempts;
  int next_task = -1;   // where the next page starts; -1: there is none
  int next_number = 1;  // its attempt
};

// `now_us`: Clock::MonotonicUs.
JobStatus StatusOfJob(const Job& job, int job_index, const LeaseTable& leases, int64_t now_us);
// Shows a job that has ended as it was before, because its end is not durable yet.
void TakeEndFrom(JobStatus& status);
TaskStatus StatusOfTask(const Job& job, TaskRef ref, const LeaseTable& leases);

}  // namespace tessera
