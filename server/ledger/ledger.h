// The coordinator's durable state in memory: what all records so far add up to. A pure state machine without time,
// files or threads.
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
  // `algorithm_version` enters the keys of tasks.
  explicit Ledger(std::string algorithm_version) : algorithm_version_(std::move(algorithm_version)) {}
  Ledger(const Ledger&) = delete;
  Ledger& operator=(const Ledger&) = delete;

  // Whether the record may follow: NOT_FOUND for what does not exist, FAILED_PRECONDITION for what is no longer or not
  // yet so, INVALID_ARGUMENT for a malformed record.
  Status Check(const v1::Record& record) const;
  // The only way in which state changes. The record must have passed Check on this very state.
  void Apply(const v1::Record& record);

  const std::vector<Job>& jobs() const { return jobs_; }
  // Indices of the jobs that have not ended, oldest first.
  const std::vector<int>& active_jobs() const { return active_jobs_; }
  // How many of these the client submitted.
  int ActiveJobsOf(const std::string& client) const;
  // Jobs that were not deleted.
  int kept_jobs() const { return static_cast<int>(jobs_.size()) - deleted_jobs_; }
  // Of the jobs that have not ended, those that wait for the coordinator: to be planned on, or to be ended.
  const std::set<int>& due_jobs() const { return due_jobs_; }
  // The ready tasks of jobs of which no task has failed.
  const ReadyTasks& ready() const { return ready_; }
  // Lets the tasks of a job run, which is held from each plan with predicted outputs on. Not recorded.
  void Admit(int job) { ready_.Admit(job); }
  // Tasks whose delay is over are found in ready() from now on; new delays begin. `now_us`: Clock::MonotonicUs.
  void PromoteRetries(int64_t now_us) { ready_.Promote(now_us); }
  // Tasks that became ready since the last call, each once, in the order in which they did; some may have left since.
  std::vector<TaskRef> TakeNewlyReady();
  const std::vector<TaskRef>& newly_ready() const { return newly_ready_; }
  // Before the first record: jobs of which no record comes any more but that they were deleted.
  void ExpectDeleted(std::set<int> jobs) { expected_deleted_ = std::move(jobs); }
  // After the last record: their numbers are not given again, though none may have come.
  void EndReplay();
  // Whether there was such a job, and it was deleted.
  bool WasDeleted(int job) const;
  // FAILED_PRECONDITION with what to do first unless the job, which is there, may be deleted.
  Status MayDelete(int job) const;
  // Frees the memory of at most so many tasks of deleted jobs. False if none is left.
  bool FreeDeleted(int max_tasks);
  // FAILED_PRECONDITION with both versions, and `then`, what follows from that, if another one made the job.
  Status CheckVersion(int job, const std::string& then) const;
  // Whether tasks of the job may run: it has not ended, or results of it are being made again.
  bool Runs(int job) const;
  // NOT_FOUND or INVALID_ARGUMENT with the name.
  StatusOr<int> FindJob(const std::string& name) const;
  StatusOr<TaskRef> FindTask(const std::string& name) const;
  // Index of the job of this request; -1 if there is none, or the request has no id. ALREADY_EXISTS with what differs
  // if the id was used for another request.
  StatusOr<int> FindRequest(const JobRequest& request) const;
  const JobTask& task(TaskRef ref) const { return jobs_[ref.job].tasks[ref.task]; }

  // The input's content; NOT_FOUND while its producer has not succeeded.
  StatusOr<Digest> InputDigest(const Job& job, const PlannedInput& input) const;
  // What the task reads, by the names under which it does: outputs of tasks in the order of task.inputs, then
  // task.scene_files, then task.view_files. NOT_FOUND as InputDigest.
  StatusOr<std::vector<NamedDigest>> InputsOf(const Job& job, const PlannedTask& task) const;
  // What an update takes from this job, without the survey's content; FAILED_PRECONDITION with what to do unless the
  // job has succeeded, made by this version.
  StatusOr<UpdateBase> BaseOf(const std::string& job) const;
  // The same for an update with these settings: of one that rolls tiles back, with the states that they go back to.
  StatusOr<UpdateBase> BaseOf(const UpdateSettings& update) const;
  // BaseOf `job`, its base, ... to `earlier`. INVALID_ARGUMENT with those that there are if that is not among them.
  StatusOr<std::vector<UpdateBase>> ChainTo(const std::string& job, const std::string& earlier) const;
  // The task that made this content and can make it again: of the job, where `own`, or of those that it goes on from,
  // the nearest first. NOT_FOUND if no task did.
  StatusOr<TaskRef> MakerOf(int job, const Digest& digest, bool own) const;
  // Tasks of jobs that have ended whose results are being made again, for others.
  const std::set<TaskRef>& remakes_of_ended() const { return remakes_of_ended_; }
  // FAILED_PRECONDITION with both digests if the task's result was lost, and what was made again is not what it was.
  Status CheckSameAsBefore(TaskRef ref, const std::vector<NamedDigest>& outputs) const;
  // Outputs of an earlier task with this key; null if none is known.
  const absl::InlinedVector<StoredFile, 1>* FindResult(const Sha256& key) const;
  // They are not stored any more.
  void ForgetResult(const Sha256& key) { tasks_of_key_.erase(key); }
  // Absolute paths at which scene files of jobs had this content when the jobs were accepted, the oldest job's first.
  std::vector<std::string> SceneFilesWith(const Digest& digest) const;

 private:
  // What tasks that ran took, of this job and those that it goes on from, as UpdateBase::measured.
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
  // Whether a job of this number may be next: not if more records would be lost than can be believed.
  bool MayBeNext(int job) const;
  void CountActive(const std::string& client, int more);
  // Jobs up to there of which no record came: deleted ones, and others whose acceptance is lost.
  void FillJobsUpTo(int job);
  void DropRemakesOf(int job);
  // Of a job whose tasks are going.
  void DropReady(int job);
  // A task that has succeeded is known by its key from now on.
  void RememberTask(TaskRef ref);
  // It is not any more; nothing if it was not.
  void ForgetTask(TaskRef ref);
  void ForgetSceneFiles(const Job& job);
  // Checks that the task exists in an active job and that `attempt` is its current one under lease.
  StatusOr<TaskRef> CheckCurrentAttempt(const std::string& name, int attempt) const;
  // Takes the tasks of a plan that was not stored to its end off the job's list.
  void DropOpenPlan(Job& job);
  // A waiting task whose inputs are all there becomes ready and gets its key.
  void ReadyTask(TaskRef ref);
  // Whether its tasks may run: its job has not ended, or its result is needed by another job and lost.
  bool MayRun(TaskRef ref) const { return !HasEnded(jobs_[ref.job].header.state) || task(ref).remaking; }
  // A task that has succeeded has not, and its readers wait.
  void Unmake(TaskRef ref);
  // The result is there again: who waits for it goes on. The task has succeeded.
  void EndRemake(TaskRef ref);
  // It cannot be made again: who waits for it fails. The task is of a job that has ended, and stays as it was.
  void GiveUpRemake(TaskRef ref, const TaskFailure& failure);
  void UpdateDue(int job);
  // Of a task that is not superseded yet: takes it off what the job does.
  void Supersede(TaskRef ref);
  // Of a job whose tasks or tiles became other ones.
  static void Recount(Job& job);
  // The first task of the job that has failed for good; -1: none.
  static int FirstFailed(const Job& job);

  const std::string algorithm_version_;
  std::vector<Job> jobs_;
  std::vector<int> active_jobs_;
  std::unordered_map<std::string, int> active_of_client_;  // none of 0
  int deleted_jobs_ = 0;
  std::set<int> due_jobs_;
  std::set<TaskRef> remakes_of_ended_;
  ReadyTasks ready_;
  std::vector<TaskRef> newly_ready_;
  std::unordered_map<std::string, int> job_of_request_;
  // Tasks that succeeded, found by their keys, which lie in the tasks. Of those with one key it has the last, and each
  // of them knows the one before (JobTask::older_with_key). Those of deleted jobs stay until FreeDeleted comes to them.
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
    int jobs = 0;  // that have it
  };
  std::unordered_map<std::string, std::vector<ScenePath>> scene_files_of_sha256_;
  std::set<int> expected_deleted_;
  std::vector<int> to_free_;  // deleted jobs that still hold tasks
};

}  // namespace tessera
