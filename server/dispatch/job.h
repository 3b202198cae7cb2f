// A job and its tasks as the coordinator knows them. Plain values; times are Unix time in microseconds, 0 for "not
// yet".
#ifndef TESSERA_SERVER_DISPATCH_JOB_H_
#define TESSERA_SERVER_DISPATCH_JOB_H_

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_usage.h"
#include "common/storage/hash.h"
#include "server/plan/graph.h"

namespace tessera {

// The numbers of these are those of tessera.v1.
enum class JobState { kQueued = 1, kRunning = 2, kSucceeded = 3, kFailed = 4, kCancelled = 5, kPartial = 6 };
enum class TaskState { kWaiting = 1, kReady = 2, kLeased = 3, kSucceeded = 4, kFailed = 5, kCancelled = 6 };
enum class ErrorClass {
  kNone = 0,
  kInput = 1,
  kTransient = 2,
  kMemory = 3,
  kPoison = 4,
  kPreempted = 5,
  kLostInput = 6,
  kScratch = 7,
  kStorage = 8,
  kPeer = 9,
  kInternal = 10
};

inline bool HasEnded(JobState state) { return state >= JobState::kSucceeded; }

struct TaskFailure {
  ErrorClass error_class = ErrorClass::kNone;
  std::string message;
  std::vector<Digest> lost_inputs = {};  // of kLostInput, as the worker tells; not stored
};

// "jobs/J/tasks/T": which task, by its places in the ledger.
struct TaskRef {
  int job = -1;
  int task = -1;
  friend auto operator<=>(const TaskRef&, const TaskRef&) = default;
};

// One run of a task by one worker, under one lease.
struct Attempt {
  std::string worker;
  std::string machine;  // that the worker ran on; empty: not known
  int64_t start_us = 0;
  int64_t end_us = 0;
  TaskFailure failure;  // kNone: it runs, has succeeded or was cancelled
  bool lease_expired = false;
  bool cancelled = false;  // its job ended, or went on without the task
};

struct JobTask {
  PlannedTask plan;
  std::vector<int> readers = {};  // tasks that take an output of this one, each as often as it takes one, ascending
  int missing = 0;                // inputs whose producers have not succeeded
  int depth = 0;                  // longest way from here to a task without inputs
  TaskState state = TaskState::kWaiting;
  std::string key;                // once all inputs are known
  std::vector<Attempt> attempts;  // attempt number n is attempts[n - 1]
  int64_t retry_delay_us = 0;     // not leased again before so much time has passed
  TaskFailure error;              // the last
  int forgiven = 0;               // attempts before the job was retried, which count no more
  bool superseded = false;        // a later plan has another in its place, or does without
  bool reused = false;            // its result was found under its key; nothing ran
  std::string stats;              // JSON
  TaskUsage usage;                // of the attempt that succeeded; zeros if reused
  std::vector<NamedDigest> outputs;
  Warnings warnings;
  int64_t start_us = 0;  // of the first attempt
  int64_t end_us = 0;
  int remakes = 0;        // how often its result was lost; `outputs` stay, for what is made again must be the same
  bool remaking = false;  // lost, and not there again yet
  // While `remaking`: who waits for it in other jobs. Tasks whose given outputs it made, or (task -1) a plan.
  std::vector<TaskRef> awaited_by = {};

  int attempt() const { return static_cast<int>(attempts.size()); }
  std::string worker() const { return attempts.empty() ? "" : attempts.back().worker; }
};

// What a user asked for, before anything is read or taken over from a base.
struct JobRequest {
  std::string id;          // may be empty
  std::string scene_path;  // empty if none is read
  JobSettings settings;
};

// What a job is, without its tasks.
struct JobHeader {
  std::string name;                   // "jobs/J"
  std::optional<JobRequest> request;  // one with an id; of jobs of earlier releases it is not known
  std::string display_name;
  std::string scene_path;  // absolute
  JobSettings settings;
  std::string algorithm_version;
  JobState state = JobState::kQueued;
  std::string error;
  int64_t create_us = 0;
  int64_t start_us = 0;
  int64_t end_us = 0;
  std::vector<NamedDigest> artifacts;
  Warnings warnings;
  int priority = 0;     // a waiting job of a higher one gets the next free worker
  bool paused = false;  // nothing more is leased; what runs goes on to its end
};

inline constexpr int kMaxPriority = 100;  // and -kMaxPriority the least
// INVALID_ARGUMENT with what was found and what was expected.
Status CheckPriority(int priority);

// What a user changes of a job; what is not set stays.
struct JobChange {
  std::optional<int> priority;
  std::optional<bool> paused;
};

// A tile that is left as it was, and its task that failed for good, by its place in the job's list.
struct SetAside {
  int tile = -1;
  int task = -1;
  friend bool operator==(const SetAside&, const SetAside&) = default;
};

// Costs of a job's tasks, and what of them is done.
struct JobSums {
  struct Part {
    double total = 0, done = 0;
    double share() const { return total > 0 ? done / total : 0; }
  };
  Part& PartOf(const std::string& kind);
  // Adds a run of the task so far: where cost meets seconds.
  void AddRun(const PlannedTask& plan, double cost, double seconds);

  int tasks = 0, tasks_done = 0;
  int tiles = 0, unfinished_tiles = 0;
  int64_t bytes_to_store = 0;  // predicted, of what is not done
  Part ingest, cut, rest;
  double timed_cost = 0, timed_s = 0;
};

// What is shown of a job's tasks, kept up to date as they change: a city has millions.
class JobTotals {
 public:
  // A task that is given is not counted. It has not succeeded yet.
  void AddPlanned(const JobTask& task);
  void AddSucceeded(int index, const JobTask& task);
  // A tile that stays unfinished whatever succeeds.
  void AddSetAside(int tile);
  // What it made is lost: it has not succeeded any more.
  void AddLost(int index, const JobTask& task);
  const JobSums& sums() const { return sums_; }
  const std::set<int>& warned() const { return warned_; }  // succeeded tasks with warnings

 private:
  JobSums sums_;
  std::set<int> warned_;
  std::map<int, int> unfinished_of_tile_;  // tasks
};

struct Job {
  JobHeader header;
  std::vector<NamedDigest> scene_files;  // sorted by name
  std::vector<JobTask> tasks;            // the first phase's first
  int unfinished = 0;                    // tasks that have not succeeded, but for superseded ones
  int failed = -1;                       // the first task that has for good; -1: none
  bool planned_to_end = false;           // publish is among the tasks, or the plan is all that is asked for
  std::vector<SetAside> set_aside;       // by tile
  bool plans_anew = false;  // what is behind the cuts, since other tiles are set aside than it was planned for
  int open_plan = -1;       // first task of a plan whose last record has not come; -1: none
  JobTotals totals;
  int lost = 0;                 // results that it needs and that are being made again, here or elsewhere
  std::string lost_error = {};  // why one that its plan reads could not be
  bool deleted = false;         // nothing else is left of it, but tasks that are being freed
};

// The task as if it had been tried only since its job was last retried.
JobTask WithCountedAttempts(JobTask task);

// Whether every tile was cut, but those that were set aside instead.
bool CutsAreDone(const Job& job);

std::string JobName(int job);
std::string TaskName(TaskRef ref);
// INVALID_ARGUMENT unless the name has the form; whether it exists is the ledger's to say.
StatusOr<int> ParseJobName(const std::string& name);
StatusOr<TaskRef> ParseTaskName(const std::string& name);

// "transient", "lease expired", ...; for people.
std::string ErrorClassName(ErrorClass error_class);

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPATCH_JOB_H_
