// A job and its tasks as the coordinator knows them. Plain values; times are Unix time in microseconds, 0 for "not
// yet".
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/container/inlined_vector.h"
#include "common/base/interned_string.h"
#include "common/base/lazy_value.h"
#include "common/base/status.h"
#include "common/base/task_usage.h"
#include "common/storage/hash.h"
#include "server/plan/planned_task.h"
#include "server/plan/update_base.h"

namespace tessera {

// The numbers of these are those of tessera.v1.
enum class JobState { kQueued = 1, kRunning = 2, kSucceeded = 3, kFailed = 4, kCancelled = 5, kPartial = 6 };
enum class TaskState : int8_t { kWaiting = 1, kReady = 2, kLeased = 3, kSucceeded = 4, kFailed = 5, kCancelled = 6 };
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
  friend bool operator==(const TaskFailure&, const TaskFailure&) = default;
};

// "jobs/J/tasks/T": which task, by its places in the ledger.
struct TaskRef {
  int job = -1;
  int task = -1;
  friend auto operator<=>(const TaskRef&, const TaskRef&) = default;
};

// One run of a task by one worker, under one lease.
struct Attempt {
  InternedString worker;
  InternedString machine;  // that the worker ran on; empty: not known
  int64_t start_us = 0;
  int64_t end_us = 0;
  LazyValue<TaskFailure> failure;  // kNone: it runs, has succeeded or was cancelled
  bool lease_expired = false;
  bool cancelled = false;  // its job ended, or went on without the task
  bool after_end = false;  // its job had ended: it makes again what was lost, and the job's report knows nothing of it
};

// A file as NamedDigest has it, in less memory.
struct StoredFile {
  InternedString name;
  Sha256 sha256;
  int64_t size_bytes = 0;

  // One whose digest was checked.
  StoredFile(const NamedDigest& file)  // NOLINT(google-explicit-constructor)
      : name(file.name), sha256(*Sha256::FromHex(file.digest.sha256)), size_bytes(file.digest.size_bytes) {}
  Digest digest() const { return {sha256.Hex(), size_bytes}; }
  operator NamedDigest() const { return {name, digest()}; }  // NOLINT(google-explicit-constructor)
  friend bool operator==(const StoredFile&, const StoredFile&) = default;
};

// Cities have millions, of all of which the coordinator holds what follows: `dispatch_bench` prints what one takes.
struct JobTask {
  PlannedTask plan;
  absl::InlinedVector<int, 4> readers;  // tasks that take an output of this one, as often as they do, ascending
  int missing = 0;                      // inputs whose producers have not succeeded
  int depth = 0;                        // longest way from here to a task without inputs
  int forgiven = 0;                     // attempts before the job was retried, which count no more
  int remakes = 0;            // how often its result was lost; `outputs` stay: what is made again must be the same
  std::optional<Sha256> key;  // once all inputs are known
  TaskState state = TaskState::kWaiting;
  bool superseded = false;                   // a later plan has another in its place, or does without
  bool reused = false;                       // its result was found under its key; nothing ran
  bool remaking = false;                     // its result is lost, and not there again yet
  absl::InlinedVector<Attempt, 1> attempts;  // attempt number n is attempts[n - 1]
  int64_t retry_delay_us = 0;                // not leased again before so much time has passed
  LazyValue<TaskFailure> error;              // the last
  std::string stats;                         // JSON
  TaskUsage usage;                           // of the attempt that succeeded; zeros if reused
  absl::InlinedVector<StoredFile, 1> outputs;
  LazyValue<Warnings> warnings;
  int64_t start_us = 0;  // of the first attempt
  int64_t end_us = 0;
  // While `remaking`: who waits for it in other jobs. Tasks whose given outputs it made, or (task -1) a plan.
  LazyValue<std::vector<TaskRef>> awaited_by;
  TaskRef older_with_key;  // of Ledger::tasks_of_key_

  int attempt() const { return static_cast<int>(attempts.size()); }
  std::string worker() const { return attempts.empty() ? "" : attempts.back().worker.str(); }
  std::string key_hex() const { return key ? key->Hex() : ""; }
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
  std::string client;   // who submitted it; empty: of an earlier release
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
struct QuarantinedTile {
  int tile = -1;
  int task = -1;
  friend bool operator==(const QuarantinedTile&, const QuarantinedTile&) = default;
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
  void AddQuarantined(int tile);
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
  std::deque<JobTask> tasks;             // the first phase's first; a vector that grows would need three times as much
  int unfinished = 0;                    // tasks that have not succeeded, but for superseded ones
  int failed = -1;                       // the first task that has for good; -1: none
  bool planned_to_end = false;           // publish is among the tasks, or the plan is all that is asked for
  std::vector<QuarantinedTile> quarantined;  // by tile
  bool plans_anew = false;  // what is behind the cuts, because other tiles are quarantined than it was planned for
  int open_plan = -1;       // first task of a plan whose last record has not come; -1: none
  JobTotals totals;
  int lost = 0;                 // results that it needs and that are being made again, here or elsewhere
  std::string lost_error = {};  // why one that its plan reads could not be
  bool deleted = false;         // nothing else is left of it, but tasks that are being freed
};

// The task as if it had been tried only since its job was last retried.
JobTask WithCountedAttempts(JobTask task);

// Whether every tile was cut, but those that are quarantined.
bool CutsAreDone(const Job& job);

std::string JobName(int job);
std::string TaskName(TaskRef ref);
// INVALID_ARGUMENT unless the name has the form; whether it exists is the ledger's to say.
StatusOr<int> ParseJobName(const std::string& name);
StatusOr<TaskRef> ParseTaskName(const std::string& name);

// "transient", "lease expired", ...; for people.
std::string ErrorClassName(ErrorClass error_class);

}  // namespace tessera
