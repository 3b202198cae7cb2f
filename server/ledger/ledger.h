// The coordinator's durable state in memory: all jobs and tasks after applying all records. A pure state machine
// without time, files or threads.
#pragma once

#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "absl/container/flat_hash_set.h"
#include "absl/hash/hash.h"
#include "common/base/status.h"
#include "server/ledger/job.h"
#include "server/ledger/ready_tasks.h"

namespace tessera {

namespace v1 {
class Record;
class JobAccepted;
class TasksPlanned;
class AttemptStarted;
class TaskSucceeded;
class AttemptFailed;
class JobEnded;
class JobChanged;
class TileQuarantined;
class JobRetried;
class ResultLost;
class JobDeleted;
class JobRestarted;
}  // namespace v1

// Change of state: Check (may fail) → store the record → Apply (cannot fail). Equal records give equal ledgers. Not
// thread-safe.
class Ledger {
 public:
  // `algorithm_version` is part of the keys of tasks.
  explicit Ledger(std::string algorithm_version) : algorithm_version_(std::move(algorithm_version)) {}
  Ledger(const Ledger&) = delete;
  Ledger& operator=(const Ledger&) = delete;

  // Whether the record may be applied. NOT_FOUND: its job or task does not exist; FAILED_PRECONDITION: the state does
  // not allow it; INVALID_ARGUMENT: the record is malformed.
  Status Check(const v1::Record& record) const;
  // The only function that changes recorded state. Precondition: Check accepts the record in the present state.
  void Apply(const v1::Record& record);

  const std::vector<Job>& jobs() const { return jobs_; }
  // Indices of the jobs that have not ended, oldest first.
  const std::vector<int>& active_jobs() const { return active_jobs_; }
  int ActiveJobsOf(const std::string& client) const;
  // Jobs that were not deleted.
  int kept_jobs() const { return static_cast<int>(jobs_.size()) - deleted_jobs_; }
  // Active jobs on which the coordinator must act: plan the next phase or end the job.
  const std::set<int>& due_jobs() const { return due_jobs_; }
  // The ready tasks of jobs without a failed task.
  const ReadyTasks& ready() const { return ready_; }
  // Releases a job; each plan with predicted outputs holds it again. Not recorded.
  void Admit(int job) { ready_.Admit(job); }
  // Moves tasks whose retry delay has elapsed into ready() and starts new delays. `now_us`: Clock::MonotonicUs.
  void PromoteRetries(int64_t now_us) { ready_.Promote(now_us); }
  // Tasks that became ready since the last call, oldest first, each once. Some may no longer be ready.
  std::vector<TaskRef> TakeNewlyReady();
  const std::vector<TaskRef>& newly_ready() const { return newly_ready_; }
  // Call before the first record. `jobs`: deleted jobs, whose other records are no longer replayed.
  void ExpectDeleted(std::set<int> jobs) { expected_deleted_ = std::move(jobs); }
  // Call after the last record. Reserves the numbers of deleted jobs without any record.
  void EndReplay();
  bool WasDeleted(int job) const;
  // FAILED_PRECONDITION with what to do first if the job may not be deleted. Precondition: the job exists.
  Status MayDelete(int job) const;
  // Frees the memory of at most so many tasks of deleted jobs. False if none is left.
  bool FreeDeleted(int max_tasks);
  // FAILED_PRECONDITION with both versions and `then` (the consequence) if the job is of another algorithm version.
  Status CheckVersion(int job, const std::string& then) const;
  // Whether tasks of the job may run: it is active, or lost results of it are being recomputed.
  bool Runs(int job) const;
  // NOT_FOUND or INVALID_ARGUMENT.
  StatusOr<int> FindJob(const std::string& name) const;
  StatusOr<TaskRef> FindTask(const std::string& name) const;
  // Index of the job of this request; -1 if there is none or the request has no id. ALREADY_EXISTS with the differences
  // if another request had the same id.
  StatusOr<int> FindRequest(const JobRequest& request) const;
  const JobTask& task(TaskRef ref) const { return jobs_[ref.job].tasks[ref.task]; }

  // Digest of the input; NOT_FOUND while its producer has not succeeded.
  StatusOr<Digest> InputDigest(const Job& job, const PlannedInput& input) const;
  // Input files of the task under the names by which it reads them: task.inputs, then task.scene_files, then
  // task.view_files. Errors as InputDigest.
  StatusOr<std::vector<NamedDigest>> InputsOf(const Job& job, const PlannedTask& task) const;
  // The job as base of an update; the survey is not read. FAILED_PRECONDITION with what to do if the job has not
  // succeeded, published nothing or is of another algorithm version.
  StatusOr<UpdateBase> BaseOf(const std::string& job) const;
  // The same for an update with these settings; tiles to roll back have the states of `update.rollback_to`.
  StatusOr<UpdateBase> BaseOf(const UpdateSettings& update) const;
  // BaseOf each job on the chain of bases from `job` to `earlier`. INVALID_ARGUMENT with the chain if it lacks
  // `earlier`.
  StatusOr<std::vector<UpdateBase>> ChainTo(const std::string& job, const std::string& earlier) const;
  // The task that can recompute this content: of the job itself (if `own`) or of its base jobs, nearest first.
  // NOT_FOUND if no task made it.
  StatusOr<TaskRef> MakerOf(int job, const Digest& digest, bool own) const;
  // Tasks of ended jobs whose lost results are being recomputed for other jobs or a download.
  const std::set<TaskRef>& remakes_of_ended() const { return remakes_of_ended_; }
  // FAILED_PRECONDITION with both digests if the task recomputed a lost result and the outputs differ.
  Status CheckSameAsBefore(TaskRef ref, const std::vector<NamedDigest>& outputs) const;
  // Outputs of an earlier task with this key; null if none is known.
  const absl::InlinedVector<StoredFile, 1>* FindResult(const Sha256& key) const;
  // Call if the blobs of the result are no longer stored.
  void ForgetResult(const Sha256& key) { tasks_of_key_.erase(key); }
  // Absolute paths of scene files that had this content when their jobs were accepted, oldest job first.
  std::vector<std::string> SceneFilesWith(const Digest& digest) const;

 private:
  // Predicted and used cost of the tasks that ran in this job and its base jobs: UpdateBase::measured.
  MeasuredCosts MeasuredIn(const Job& last) const;
  Status CheckAccepted(const v1::JobAccepted& change) const;
  Status CheckPlanned(const v1::TasksPlanned& change) const;
  Status CheckStarted(const v1::AttemptStarted& change) const;
  Status CheckSucceeded(const v1::TaskSucceeded& change) const;
  Status CheckFailed(const v1::AttemptFailed& change) const;
  Status CheckEnded(const v1::JobEnded& change) const;
  Status CheckChanged(const v1::JobChanged& change) const;
  Status CheckQuarantined(const v1::TileQuarantined& change) const;
  Status CheckRetried(const v1::JobRetried& change) const;
  Status CheckLost(const v1::ResultLost& change) const;
  Status CheckDeleted(const v1::JobDeleted& change) const;
  Status CheckRestarted(const v1::JobRestarted& change) const;
  void ApplyAccepted(const v1::JobAccepted& change, int64_t time_us);
  void ApplyPlanned(const v1::TasksPlanned& change);
  void ApplyStarted(const v1::AttemptStarted& change, int64_t time_us);
  void ApplySucceeded(const v1::TaskSucceeded& change, int64_t time_us);
  void ApplyFailed(const v1::AttemptFailed& change, int64_t time_us);
  void ApplyEnded(const v1::JobEnded& change, int64_t time_us);
  void ApplyChanged(const v1::JobChanged& change);
  void ApplyQuarantined(const v1::TileQuarantined& change);
  void ApplyRetried(const v1::JobRetried& change);
  void ApplyLost(const v1::ResultLost& change);
  void ApplyDeleted(const v1::JobDeleted& change);
  void ApplyRestarted(const v1::JobRestarted& change);
  // Whether a new job may have this index. A gap of more than kMaxLostJobs lost records is an error.
  bool MayBeNext(int job) const;
  void CountActive(const std::string& client, int more);
  // Appends the jobs below this index without a record: deleted ones, and failed ones whose acceptance is lost.
  void FillJobsUpTo(int job);
  void DropRemakesOf(int job);
  // Call before the tasks of the job are dropped.
  void DropReady(int job);
  // Adds a succeeded task to tasks_of_key_.
  void RememberTask(TaskRef ref);
  // Removes it; no effect if it is absent.
  void ForgetTask(TaskRef ref);
  void ForgetSceneFiles(const Job& job);
  // The task, if it may run and `attempt` is its leased attempt; else NOT_FOUND or FAILED_PRECONDITION.
  StatusOr<TaskRef> CheckCurrentAttempt(const std::string& name, int attempt) const;
  // Removes the tasks of a plan whose last record was not stored.
  void DropOpenPlan(Job& job);
  // Makes a waiting task ready and sets its key if all inputs exist.
  void ReadyTask(TaskRef ref);
  // Whether the task may run: its job is active, or its lost result is being recomputed.
  bool MayRun(TaskRef ref) const { return !HasEnded(jobs_[ref.job].header.state) || task(ref).remaking; }
  // Takes the success of a task back; its readers wait.
  void Unmake(TaskRef ref);
  // Releases all readers of a recomputed result. Precondition: the task has succeeded.
  void EndRemake(TaskRef ref);
  // Fails all readers of a result that cannot be recomputed. The task is of an ended job and keeps its state.
  void GiveUpRemake(TaskRef ref, const TaskFailure& failure);
  void UpdateDue(int job);
  // Removes the task from the job's work. Precondition: it is not superseded.
  void Supersede(TaskRef ref);
  // Computes the totals of a job after its tasks or tiles changed.
  static void Recount(Job& job);
  // The first task of the job that failed permanently; -1: none.
  static int FirstFailed(const Job& job);

  const std::string algorithm_version_;
  std::vector<Job> jobs_;
  std::vector<int> active_jobs_;
  std::unordered_map<std::string, int> active_of_client_;  // counts above 0
  int deleted_jobs_ = 0;
  std::set<int> due_jobs_;
  std::set<TaskRef> remakes_of_ended_;
  ReadyTasks ready_;
  std::vector<TaskRef> newly_ready_;
  std::unordered_map<std::string, int> job_of_request_;
  // Succeeded tasks by key; the set stores indices because a city has millions of keys. It has the newest task of each
  // key, and JobTask::older_with_key links the older ones. FreeDeleted removes tasks of deleted jobs.
  struct HashOfKey {
    using is_transparent = void;
    size_t operator()(const Sha256& key) const { return absl::Hash<Sha256>()(key); }
    size_t operator()(TaskRef ref) const { return (*this)(*ledger->task(ref).key); }
    const Ledger* ledger;
  };
  struct SameKey {
    using is_transparent = void;
    const Sha256& KeyOf(const Sha256& key) const { return key; }
    const Sha256& KeyOf(TaskRef ref) const { return *ledger->task(ref).key; }
    template <class A, class B>
    bool operator()(const A& a, const B& b) const {
      return KeyOf(a) == KeyOf(b);
    }
    const Ledger* ledger;
  };
  absl::flat_hash_set<TaskRef, HashOfKey, SameKey> tasks_of_key_{0, HashOfKey{this}, SameKey{this}};
  struct ScenePath {
    std::string path;
    int jobs = 0;  // number of jobs with this path
  };
  std::unordered_map<std::string, std::vector<ScenePath>> scene_files_of_sha256_;
  std::set<int> expected_deleted_;
  std::vector<int> to_free_;  // deleted jobs that still hold tasks
};

}  // namespace tessera
