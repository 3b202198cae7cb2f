// Jobs and tasks for display: the ledger's state with the progress that workers report. Plain values.
#pragma once

#include <string>
#include <vector>

#include "server/leases/lease_table.h"
#include "server/ledger/ledger.h"

namespace tessera {

inline constexpr size_t kMaxShownArtifacts = 1000;

struct JobStatus {
  JobHeader header;                    // with the warnings of the job and its tasks
  std::vector<NamedDigest> artifacts;  // the first ones
  int artifacts_total = 0;
  int tasks_total = 0;  // planned so far
  int tasks_done = 0;
  int tiles_total = 0;
  int tiles_done = 0;   // refined
  double progress = 0;  // in [0, 1], by predicted cost; never decreases
  double eta_s = -1;    // negative: unknown, like the next two
  // Range of eta_s if the number of running tasks stays: kRefineSecondsInterval.
  double eta_low_s = -1, eta_high_s = -1;
  double core_seconds = 0;            // used by tasks that succeeded
  double predicted_core_seconds = 0;  // of all tasks planned so far
  std::string stage;                  // what it does, for people (StageText)
  std::string waiting_for;            // why it makes no progress (WaitingFor)
};

struct TaskStatus {
  std::string name;
  JobTask task;
  double progress = 0;  // of the current attempt
  std::string stage;
};

// A job with its running tasks.
struct WatchedJob {
  JobStatus job;
  std::vector<TaskStatus> running;
  bool end_waits = false;  // the job has ended, but its end is not durable and not shown
};

// Has the numbers of tessera.v1.
enum class AttemptOutcome { kRunning = 1, kSucceeded = 2, kFailed = 3, kLeaseExpired = 4, kCancelled = 5 };
AttemptOutcome OutcomeOf(const Attempt& attempt);

// An attempt and its task.
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
  int next_task = -1;   // first task of the next page; -1: none
  int next_number = 1;  // its first attempt on that page
};

struct ArtifactPage {
  std::vector<NamedDigest> artifacts;
  int next = -1;  // index of the first file of the next page; -1: none
};

// The functions below need the core's mutex. `now_us`: Clock::MonotonicUs. `max_artifacts`: as many are copied.
JobStatus StatusOfJob(const Job& job, int job_index, const LeaseTable& leases, int64_t now_us,
                      size_t max_artifacts = kMaxShownArtifacts);
// What the job does, for people: "solving step 12 of 35, 31 of 40 tiles". Of several stages that run side by side, the
// first one. Empty if the job has ended or no task of it runs or is ready. Steps have the numbers of the tasks' names.
std::string StageText(const Ledger& ledger, int job, const LeaseTable& leases);
// Undoes the end of a job in its status, because the end is not durable yet.
void TakeEndFrom(JobStatus& status);
TaskStatus StatusOfTask(const Job& job, TaskRef ref, const LeaseTable& leases);

}  // namespace tessera
