// The coordinator's durable state in memory: all jobs and tasks after applying all records. A pure state machine
// without time, files or threads.
#pragma once

#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "server/ledger/content_index.h"
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

// Change of state: CheckRecord (may fail) → Apply (cannot fail) → Journal::Add (stores it). Equal records give equal
// ledgers. Not thread-safe.
class Ledger {
 public:
  // `algorithm_version` is part of the keys of tasks.
  explicit Ledger(std::string algorithm_version) : algorithm_version_(std::move(algorithm_version)) {}
  Ledger(const Ledger&) = delete;
  Ledger& operator=(const Ledger&) = delete;

  // The only function that changes recorded state. Precondition: CheckRecord accepts the record in the present state.
  void Apply(const v1::Record& record);
  // Call before the first record. `jobs`: deleted jobs, whose other records are no longer replayed.
  void ExpectDeleted(std::set<int> jobs) { expected_deleted_ = std::move(jobs); }
  const std::set<int>& expected_deleted() const { return expected_deleted_; }

  const std::vector<Job>& jobs() const { return jobs_; }
  const JobTask& task(TaskRef ref) const { return jobs_[ref.job].tasks[ref.task]; }
  // NOT_FOUND or INVALID_ARGUMENT.
  StatusOr<int> FindJob(const std::string& name) const;
  StatusOr<TaskRef> FindTask(const std::string& name) const;
  // Indices of the jobs by the id of their request, without jobs that have none.
  const std::unordered_map<std::string, int>& job_of_request() const { return job_of_request_; }
  // FAILED_PRECONDITION with both versions and `then` (the consequence) if the job is of another algorithm version.
  Status CheckVersion(int job, const std::string& then) const;

  // Indices of the jobs that have not ended, oldest first.
  const std::vector<int>& active_jobs() const { return active_jobs_; }
  // Active jobs on which the coordinator must act: plan the next phase or end the job.
  const std::set<int>& due_jobs() const { return due_jobs_; }
  // Tasks of ended jobs whose lost results are being recomputed for other jobs or a download.
  const std::set<TaskRef>& remakes_of_ended() const { return remakes_of_ended_; }
  // The ready tasks of jobs without a failed task. Each plan with predicted outputs holds its job again. Callers may
  // admit jobs and promote tasks, which is not recorded.
  ReadyTasks& ready() { return ready_; }
  const ReadyTasks& ready() const { return ready_; }
  // Tasks that became ready since the last call of TakeNewlyReady, oldest first, each once. Some may no longer be
  // ready.
  const std::vector<TaskRef>& newly_ready() const { return newly_ready_; }
  std::vector<TaskRef> TakeNewlyReady() { return std::exchange(newly_ready_, {}); }

  // Results by key. Callers may forget those whose blobs are gone, which is not recorded.
  ResultIndex& results() { return results_; }
  const SceneFileIndex& scene_files() const { return scene_files_; }
  // Frees the memory of at most so many tasks of deleted jobs. False if none is left.
  bool FreeDeleted(int max_tasks);

 private:
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
  // Appends the jobs below this index without a record: deleted ones, and failed ones whose acceptance is lost.
  void FillJobsUpTo(int job);
  // Call before the tasks of the job are dropped.
  void DropReady(int job);
  // Removes the tasks of a plan whose last record was not stored.
  void DropOpenPlan(Job& job);
  // Makes a waiting task ready and sets its key if all inputs exist.
  void ReadyTask(TaskRef ref);
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
  // After a task of a tile failed or is retried: everything behind the cuts of its part is planned again.
  static void PlanAgainBehindCuts(Job& job, int failed);

  const std::string algorithm_version_;
  std::vector<Job> jobs_;
  std::vector<int> active_jobs_;
  std::set<int> due_jobs_;
  std::set<TaskRef> remakes_of_ended_;
  ReadyTasks ready_;
  std::vector<TaskRef> newly_ready_;
  std::unordered_map<std::string, int> job_of_request_;
  ResultIndex results_{&jobs_};
  SceneFileIndex scene_files_;
  std::set<int> expected_deleted_;
  std::vector<int> to_free_;  // deleted jobs that still hold tasks
};

}  // namespace tessera
