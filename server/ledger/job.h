// A job and its tasks in the coordinator's memory. Plain values, not thread-safe. Times are Unix time in microseconds;
// 0: not yet.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/container/inlined_vector.h"
#include "common/base/interned_string.h"
#include "common/base/lazy_value.h"
#include "common/base/status.h"
#include "common/base/task_usage.h"
#include "common/storage/hash.h"
#include "server/plan/planned_task.h"
#include "server/plan/stages.h"
#include "server/plan/update_base.h"

namespace tessera {

// The three enums have the numbers of tessera.v1.
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
  std::vector<Digest> lost_inputs = {};  // of kLostInput, as reported by the worker; not stored
  friend bool operator==(const TaskFailure&, const TaskFailure&) = default;
};

// The task "jobs/J/tasks/T" by its indices in the ledger.
struct TaskRef {
  int job = -1;
  int task = -1;
  friend auto operator<=>(const TaskRef&, const TaskRef&) = default;
};

// One run of a task by one worker, under one lease.
struct Attempt {
  InternedString worker;
  InternedString machine;  // host of the worker; empty: not known
  int64_t start_us = 0;
  int64_t end_us = 0;
  LazyValue<TaskFailure> failure;  // kNone: running, succeeded or cancelled
  bool lease_expired = false;
  bool cancelled = false;  // its job ended, or a new plan dropped the task
  bool after_end = false;  // recomputes a lost result of an ended job; not in the job's report
};

// NamedDigest in less memory.
struct StoredFile {
  InternedString name;
  Sha256 sha256;
  int64_t size_bytes = 0;

  // Precondition: CheckDigest accepts the digest.
  StoredFile(const NamedDigest& file)  // NOLINT(google-explicit-constructor)
      : name(file.name), sha256(*Sha256::FromHex(file.digest.sha256)), size_bytes(file.digest.size_bytes) {}
  Digest digest() const { return {sha256.Hex(), size_bytes}; }
  operator NamedDigest() const { return {name, digest()}; }  // NOLINT(google-explicit-constructor)
  friend bool operator==(const StoredFile&, const StoredFile&) = default;
};

// A task in memory. A city has millions: `dispatch_bench` prints the bytes of one.
struct JobTask {
  PlannedTask plan;
  absl::InlinedVector<int, 4> readers;  // tasks that read outputs of this one, once per input, ascending
  int missing = 0;                      // inputs whose producers have not succeeded
  int depth = 0;                        // tasks on the longest path from a task without inputs
  int forgiven = 0;                     // attempts before the last retry of the job; they no longer count
  int remakes = 0;                      // losses of its result; `outputs` stay, as the new ones must be equal
  std::optional<Sha256> key;            // set when all inputs are known
  TaskState state = TaskState::kWaiting;
  bool superseded = false;                   // a later plan replaced or dropped it
  bool reused = false;                       // its result was found under its key
  bool remaking = false;                     // its result is lost and not yet recomputed
  absl::InlinedVector<Attempt, 1> attempts;  // attempt number n is attempts[n - 1]
  int64_t retry_delay_us = 0;                // time to wait before the next lease
  LazyValue<TaskFailure> error;              // of the last failure
  std::string stats;                         // JSON
  TaskUsage usage;                           // of the successful attempt; zeros if reused
  absl::InlinedVector<StoredFile, 1> outputs;
  LazyValue<Warnings> warnings;
  int64_t start_us = 0;  // of the first attempt
  int64_t end_us = 0;
  // While `remaking`: the readers in other jobs, which are given tasks with its outputs or (task -1) a job's planning.
  LazyValue<std::vector<TaskRef>> awaited_by;
  TaskRef older_with_key;  // list of tasks with equal keys, see ResultIndex

  int attempt() const { return static_cast<int>(attempts.size()); }
  std::string worker() const { return attempts.empty() ? "" : attempts.back().worker.str(); }
  std::string key_hex() const { return key ? key->Hex() : ""; }
};

// A job as submitted, before its scene or its base is read.
struct JobRequest {
  std::string id;          // may be empty
  std::string scene_path;  // empty: no scene
  JobSettings settings;
};

// A job without its tasks.
struct JobHeader {
  std::string name;                   // "jobs/J"
  std::optional<JobRequest> request;  // set if it has an id and the release stored it
  std::string display_name;
  std::string scene_path;  // absolute
  JobSettings settings;
  std::string algorithm_version;
  JobState state = JobState::kQueued;
  std::string error;
  bool bad_input = false;  // it could not be planned because its scene or its settings are wrong
  int64_t create_us = 0;
  int64_t start_us = 0;
  int64_t end_us = 0;
  Warnings warnings;
  std::string client;   // that submitted it; empty: submitted to an earlier release
  int priority = 0;     // free workers take the tasks of the highest first
  bool paused = false;  // no new leases; running attempts continue
};

inline constexpr int kMaxPriority = 100;  // the lowest is -kMaxPriority
// INVALID_ARGUMENT if out of range.
Status CheckPriority(int priority);

// A change of a job by a user; unset fields stay as they are.
struct JobChange {
  std::optional<int> priority;
  std::optional<bool> paused;
};

// A quarantined tile, which keeps its input surface, and the index of its task that failed permanently.
struct QuarantinedTile {
  int tile = -1;
  int task = -1;
  friend bool operator==(const QuarantinedTile&, const QuarantinedTile&) = default;
};

// Sums over a job's tasks, for its progress.
struct JobSums {
  struct Part {
    double total = 0, done = 0;
    double share() const { return total > 0 ? done / total : 0; }
  };
  Part& PartOf(const std::string& kind);
  // Adds `seconds` of run time for `cost`, from which the time left is estimated.
  void AddRun(const PlannedTask& plan, double cost, double seconds);

  int tasks = 0, tasks_done = 0;
  int tiles = 0, unfinished_tiles = 0;
  int64_t bytes_to_store = 0;  // predicted, of tasks not yet done
  Part ingest, cut, rest;
  double later = 0;  // predicted cost of tasks that are planned later, until the job is planned to the end
  int64_t later_bytes = 0;
  double timed_cost = 0, timed_s = 0;
  double core_seconds = 0;  // used by tasks that succeeded, also if their results were lost later
};

// Sums over the tasks of a tile, so that tiles are listed without visiting all their tasks.
struct TileTotals {
  std::vector<int> tasks;       // indices in the job's list, ascending; without superseded and given ones
  std::vector<int> superseded;  // those with attempts, ascending
  int unfinished = 0;           // of `tasks`; a quarantined tile has one more
  int reused = 0;
  int attempts = 0, failed_attempts = 0;                     // also of superseded tasks
  double core_seconds = 0;                                   // as in JobSums
  double predicted_core_seconds = 0, done_core_seconds = 0;  // predicted: of all tasks, of those that succeeded
  int64_t peak_bytes = 0, predicted_peak_bytes = 0;          // largest of a task; 0: unknown
  // All of `tasks` before this position have succeeded. FirstOpen moves it.
  mutable size_t open_from = 0;

  // Position of the first task that has not succeeded; tasks.size() if there is none. Over all calls it visits each
  // success once.
  size_t FirstOpen(const std::deque<JobTask>& all) const;
};

// Progress of the tasks with one depth and kind: of a stage of all tiles.
struct StageCount {
  int planned = 0, done = 0;
};

// Ranges of memory for WorkByPhase, 16 per factor of 2: the task needs at most 2^(step / 16) GiB.
inline constexpr int kUnknownMemoryStep = -1'000'000;  // no prediction
int MemoryStep(int64_t peak_bytes);

// The tasks of a job with one depth and one memory step.
struct PhaseWork {
  int64_t planned = 0, unfinished = 0;               // tasks
  double planned_core_s = 0, unfinished_core_s = 0;  // predicted
  double most_core_s = 0;                            // of one planned task
};
// By depth and memory step. Without given tasks.
using WorkByPhase = std::map<std::pair<int, int>, PhaseWork>;

// Totals of a job's tasks, updated at each change because a city has millions. Not thread-safe.
class JobTotals {
 public:
  // Does not count a given task. Precondition: the task has not succeeded.
  void AddPlanned(int index, const JobTask& task);
  void AddSucceeded(int index, const JobTask& task);
  // A quarantined tile stays unfinished.
  void AddQuarantined(int tile);
  // The task's result is lost: it no longer counts as succeeded.
  void AddLost(int index, const JobTask& task);
  // An attempt of a task of this tile has started or failed. No effect for tiles without tasks.
  void AddAttempt(int tile, int attempts, int failed);
  // A task with attempts was superseded. No effect for tiles without tasks.
  void AddSuperseded(int index, int tile);
  const JobSums& sums() const { return sums_; }
  const std::map<int, TileTotals>& tiles() const { return tiles_; }
  // Of the tasks with the same depth and kind as this one.
  StageCount StageOf(const JobTask& task) const;
  const std::set<int>& warned() const { return warned_; }  // indices of succeeded tasks with warnings
  // Empty if the job has ended.
  const WorkByPhase& work() const { return work_; }
  void ForgetWork() { work_.clear(); }

 private:
  JobSums sums_;
  std::set<int> warned_;
  std::map<int, TileTotals> tiles_;
  std::map<std::pair<int, int>, StageCount> stages_;  // by depth and KindIndex
  WorkByPhase work_;
};

struct Job {
  JobHeader header;
  std::vector<NamedDigest> scene_files;      // sorted by name
  std::vector<NamedDigest> artifacts = {};   // published files
  std::deque<JobTask> tasks;                 // by phase; a growing vector would need three times the memory
  int unfinished = 0;                        // tasks that have not succeeded, without superseded ones
  int failed = -1;                           // first task that failed permanently; -1: none
  bool planned_to_end = false;               // has a publish or export task, or only a plan was requested
  std::vector<QuarantinedTile> quarantined;  // sorted by tile
  // First task to plan again, since a tile was quarantined or retried: the first behind the cuts of a part. -1: none.
  int replan_from = -1;
  int open_plan = -1;                        // first task of a plan whose last record is missing; -1: none
  JobTotals totals;
  int lost = 0;                 // lost results that it waits for, its own and of other jobs
  std::string lost_error = {};  // why an input of its plan could not be recomputed
  bool deleted = false;         // only its name, state and tasks not yet freed remain
};

// The task without the attempts before the last retry of its job.
JobTask WithCountedAttempts(JobTask task);

// Predicted bytes that its tasks will store, also those that are not planned yet.
int64_t BytesToStore(const Job& job);

// Whether all tiles but the quarantined ones are cut; if a part is to be planned again, in the tasks before it.
bool CutsAreDone(const Job& job);
// The task that split the faces that a task of a tile reads, if it belongs to the fine part of a job that splits faces
// twice (JobPart); else null.
const JobTask* SplitBefore(const Job& job, const PlannedTask& task);
inline bool IsOfFinePart(const Job& job, const PlannedTask& task) { return SplitBefore(job, task) != nullptr; }
// What the planner must know of a quarantined tile.
FailedTile FailedTileOf(const Job& job, const QuarantinedTile& tile);
// Index of the first task behind the cuts of the present fine part, or of the first or only part.
int FirstBehindCuts(const Job& job, bool fine);

std::string JobName(int job);
std::string TaskName(TaskRef ref);
// INVALID_ARGUMENT if the name is malformed. They do not check that the job or task exists.
StatusOr<int> ParseJobName(const std::string& name);
StatusOr<TaskRef> ParseTaskName(const std::string& name);

// For messages: "transient", "lost input", ...
std::string ErrorClassName(ErrorClass error_class);

}  // namespace tessera
