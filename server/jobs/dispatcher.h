// The coordinator's core: accepts jobs, hands out their tasks under leases, and carries results on to the tasks that
// wait for them.
#ifndef TESSERA_SERVER_JOBS_DISPATCHER_H_
#define TESSERA_SERVER_JOBS_DISPATCHER_H_

#include <atomic>
#include <condition_variable>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <shared_mutex>
#include <string>
#include <thread>
#include <vector>

#include "absl/container/flat_hash_set.h"
#include "common/base/clock.h"
#include "common/base/status.h"
#include "common/storage/blob_store.h"
#include "common/storage/blob_sweep.h"
#include "server/jobs/dispatch_snapshot.h"
#include "server/jobs/job_status.h"
#include "server/jobs/planner.h"
#include "server/jobs/retention.h"
#include "server/jobs/waiting_for.h"
#include "server/leases/job_limits.h"
#include "server/leases/lease_call.h"
#include "server/leases/lease_table.h"
#include "server/leases/retry_rule.h"
#include "server/leases/waiting_workers.h"
#include "server/leases/work_thread.h"
#include "server/leases/worker_evidence.h"
#include "server/ledger/blob_references.h"
#include "server/ledger/changed_task.h"
#include "server/ledger/job.h"
#include "server/ledger/ledger.h"
#include "server/store/journal.h"
#include "server/store/record_store.h"

namespace tessera {

struct KnownTask;

struct DispatchOptions {
  double lease_s = 30;  // a lease lives that long after its last heartbeat
  // Where nobody looked for ended leases for so long, the coordinator stood still (a machine that was suspended):
  // nobody could be heard, and that time counts as no worker's silence. Tesserad looks a few times a lease.
  double stood_still_s = std::numeric_limits<double>::infinity();
  double forget_worker_s = 90;  // a silent worker without a task is forgotten after that
  double stall_s = 600;         // an attempt without progress for so long is ended; longer for tasks that take long
  double durable_wait_s = 20;   // a call whose change is not durable after that is answered with UNAVAILABLE
  RetryOptions retry;
  JobLimits limits;
  WorkerLimits worker_limits;
};

// What the dispatcher stands on; all of it must outlive it.
struct DispatchEnvironment {
  RecordStore* store = nullptr;
  BlobStore* blobs = nullptr;
  Planner* planner = nullptr;
  Clock* clock = nullptr;
  // Told of every change once it is stored, in order, by a thread of its own; for logs. Must be quick and not call
  // back. May be empty.
  std::function<void(const v1::Record&, const ChangedTask&)> on_change;
  // Told of every stored record that Open sets aside, and why. May be empty.
  std::function<void(int64_t number, const std::string& reason)> on_set_aside = {};
  // Told when changes cannot be stored any more, and why; OK when they can again. May be empty.
  std::function<void(const Status& trouble)> on_trouble = {};
  // Told of every worker that gets no tasks for some time, and why. As on_change. May be empty.
  std::function<void(const SetAsideWorker& worker)> on_worker_set_aside = {};
};

struct NewJob {
  JobRequest request;
  std::string display_name;
  std::string scene_path;  // absolute
  JobSettings settings;
  std::vector<NamedDigest> scene_files;
  Warnings warnings;
  int priority = 0;
  std::string client;  // who submits it
  // Content of the kClassifierFile among scene_files, which is stored with the job; of an update it may be empty.
  std::string classifier = {};
};

struct ReportedProgress {
  std::string task;
  int attempt = 0;
  double progress = 0;
  std::string stage;
};

struct ReportedResult {
  std::vector<NamedDigest> outputs;  // stored as blobs already
  std::string stats;
  Warnings warnings;
  TaskUsage usage;
};

struct WorkerStatus {
  std::string name;
  WorkerInfo info;
  std::vector<std::string> tasks;
  double last_seen_s = 0;             // ago
  std::string set_aside_reason = {};  // why it gets no tasks now; empty: it gets them
  double set_aside_s = 0;             // until it gets one again
};

// Thread-safe. Changes are checked and applied in memory under one mutex, and stored in batches by a journal; a call
// returns OK once what it changed is durable, UNAVAILABLE if that takes too long: the change stands, and the call may
// be repeated. On other errors nothing was changed. No file is read or written, nothing hashed and nothing planned
// under the mutex. Leases alone survive no failure of the machine: their workers' reports are refused then, and the
// tasks are leased again.
//
// Calls of workers, of which thousands may wait at once, have a form with a completion, `done`: it is called once, also
// after Stop, without a lock, from a thread of the dispatcher's or from the one that calls; it must be quick and not
// wait for the dispatcher. The other form of the same name waits for that, and for what follows from the call.
class Dispatcher {
 public:
  using Done = Journal::Done;

  // Brings back the state that the store's records describe. Tasks leased before keep their lease for a full term, so
  // that their workers can go on. A record that cannot be used is set aside; the job that it is of fails, unless it has
  // ended, and so does one that later needs what an unreadable record said.
  static StatusOr<std::unique_ptr<Dispatcher>> Open(const DispatchEnvironment& environment,
                                                    const DispatchOptions& options);
  // Does with the stored records what Open does, and no more.
  static Status SetUnusableAside(const DispatchEnvironment& environment);
  // Ends all waits first.
  ~Dispatcher();

  const DispatchOptions& options() const { return options_; }

  // The job as it would be accepted: an update with its base's settings and with the files of the base that its scene
  // lacks; one that rolls tiles back with its base's scene and all tiles that differ, if it names none. Errors, the
  // user's to read, if its settings and scene cannot be planned; UNAVAILABLE while what it needs of its base is made
  // again. Changes nothing else.
  StatusOr<NewJob> CompleteJob(NewJob job);
  // Jobs. A request whose id was used gives its job again; ALREADY_EXISTS with all that differs, a line each, if it was
  // used for another scene or other settings; errors of MayCreateJob.
  StatusOr<JobStatus> CreateJob(const NewJob& job);
  // RESOURCE_EXHAUSTED if the client, or all together, have as many jobs as they may; UNAVAILABLE while draining.
  Status MayCreateJob(const std::string& client) const;
  // None if no job has the id.
  StatusOr<std::optional<JobStatus>> FindRequest(const JobRequest& request) const;
  StatusOr<JobStatus> GetJob(const std::string& name) const;
  // Newest first: those before `before` (a job's index; -1: from the newest), at most `count`. Does not wait for what
  // is not durable: an end that is not yet is not told.
  std::vector<JobStatus> ListJobs(int before, int count) const;
  StatusOr<JobStatus> CancelJob(const std::string& name);
  // FAILED_PRECONDITION if the job has ended; INVALID_ARGUMENT for a priority out of its range.
  StatusOr<JobStatus> ChangeJob(const std::string& name, const JobChange& change);
  // Lets a job that failed or ended partially go on; of a tile: what failed of it alone. FAILED_PRECONDITION with the
  // reason if that cannot be.
  StatusOr<JobStatus> RetryJob(const std::string& name, std::optional<int> tile);
  // Forgets a job that has ended: nothing of it is shown or used again. FAILED_PRECONDITION, with what to do, if it has
  // not ended or another goes on from it. OK if it was deleted before. `reason`: for the log.
  Status DeleteJob(const std::string& name, const std::string& reason);
  // Deletes the jobs that have been kept for long enough and that no other needs. Gives how many.
  StatusOr<int> DeleteExpired(Retention& retention);
  // Frees some of the memory and of the stored records of deleted jobs, little enough for others to wait. False: all
  // is.
  StatusOr<bool> FreeDeleted();
  // Blobs that jobs refer to; what they come to refer to from now on is noted, until the next call.
  BlobReferences CollectReferences();
  // Removes those of the files that nobody has come to refer to since CollectReferences. Gives those that it removed.
  StatusOr<std::vector<BlobFile>> RemoveBlobs(const std::vector<BlobFile>& files);
  // Tasks [first, first + count) in the plan's order.
  StatusOr<std::vector<TaskStatus>> ListTasks(const std::string& job, int first, int count) const;
  // At most `count` attempts from attempt `number` of task `first` on; fewer, or none, where many tasks have none.
  StatusOr<AttemptPage> ListAttempts(const std::string& job, int first, int number, int count) const;
  StatusOr<std::vector<TaskStatus>> RunningTasks(const std::string& job) const;
  // The job as ListJobs tells it, and at most so many of its tasks that run. Waits for nothing.
  StatusOr<WatchedJob> LookAtJob(const std::string& job, size_t max_running) const;
  // Absolute paths where scene files of jobs had this content when the jobs were accepted, the oldest job's first.
  std::vector<std::string> SceneFilesWith(const Digest& digest) const;

  // Workers.
  // RESOURCE_EXHAUSTED with the limit (Refusal::kLimit) where there are too many.
  StatusOr<std::string> RegisterWorker(const WorkerInfo& info);
  // Waits for a task; none if there was none. Refusal::kUnknownWorker for a worker that is not registered (it was
  // forgotten). A worker waits once: ABORTED ends its earlier call when a later one comes.
  void LeaseTask(LeaseCall call);
  LeaseAnswer LeaseTask(const std::string& worker, double wait_s, const std::function<bool()>& gone, int64_t call = 0);
  // The worker's call that waits, if one does, may be gone: it is asked whether it is.
  void LookAfterCall(const std::string& worker);
  // Renews leases. Gives the tasks that the worker must stop.
  StatusOr<std::vector<std::string>> Heartbeat(const std::string& worker, const std::vector<ReportedProgress>& tasks);
  // Refusal::kNotCurrent if the attempt is not the current one. The same report again is OK. Statistics that are too
  // large or too deep are refused (INVALID_ARGUMENT) and end the attempt as failed.
  void ReportSuccess(const std::string& worker, const std::string& task, int attempt, const ReportedResult& result,
                     Done done);
  Status ReportSuccess(const std::string& worker, const std::string& task, int attempt, const ReportedResult& result);
  void ReportFailure(const std::string& worker, const std::string& task, int attempt, const TaskFailure& failure,
                     Done done);
  Status ReportFailure(const std::string& worker, const std::string& task, int attempt, const TaskFailure& failure);
  // Its tasks return to the queue at once.
  void UnregisterWorker(const std::string& worker, Done done);
  Status UnregisterWorker(const std::string& worker);
  std::vector<WorkerStatus> ListWorkers() const;

  // --- who_reads.cc ---
  // What each of the worker's leases is of, and its attempt: as long as it stays the same, so do their inputs.
  std::vector<std::pair<std::string, int>> LeasesOf(const std::string& worker) const;
  // SHA-256 of all that the tasks which the worker has leases of read.
  std::set<std::string> InputsOfLeases(const std::string& worker) const;
  // Whether the content is one that readers of jobs are shown: published by a job, or its survey.
  bool IsPublished(const Digest& digest) const;

  // Has a file that a job published, and that is lost or damaged, made again. NOT_FOUND if no job published it; an
  // error that tells why if it cannot be. Safe to call again while it is made.
  Status RemakeArtifact(const Digest& digest);

  // Ends expired leases and attempts that stall, plans and finishes jobs where that could not be done at once. To be
  // called about once a second.
  Status Tick();

  // Changes with every change of what is shown.
  int64_t Version() const;
  // Waits until Version() is above `seen`, Stop is called or `seconds` of real time have passed. Gives Version().
  int64_t WaitForChange(int64_t seen, double seconds) const;
  // From now on no job is accepted and nothing is leased: UNAVAILABLE, Refusal::kDraining, for those who ask or wait.
  // What was leased goes on.
  void Drain();
  // Ends all waits, now and later.
  void Stop();
  bool stopped() const;

  // Waits until all changes so far are durable.
  Status Durable() const { return journal_.Wait(journal_.last()); }
  // How it stands: what of it is a count since Open. Takes no longer for more tasks.
  DispatchSnapshot Snapshot() const;
  // Why changes cannot be stored now, and nothing is leased; OK if they can.
  Status storage_trouble() const { return journal_.trouble(); }

 private:
  Dispatcher(const DispatchEnvironment& environment, const DispatchOptions& options);
  // Those below named ...Locked need mutex_.
  Status Replay();
  // Jobs that another version planned begin anew; what it made, and was being made again, is given up.
  Status BeginOthersAnew();
  Status EndSpoiledJob(int job, const std::string& error);
  // Checks, applies and queues for the journal. Errors are those of the check.
  Status CommitLocked(v1::Record& record, Durability durability = Durability::kMachine);
  // OK if it was deleted before.
  Status DeleteJobLocked(const std::string& name, const std::string& reason);
  void NoteReferencesLocked(const v1::Record& record);
  Status FailAttemptLocked(TaskRef ref, const TaskFailure& failure);
  Status EndAttemptLocked(TaskRef ref, const RetryVerdict& verdict, bool lease_expired);
  Status ExpireLeasesLocked();
  // Whether the task's result is known, and might be stored still.
  bool MayReuseLocked(TaskRef ref) const;
  // Succeeds such a task, or forgets the result if it is not stored any more. Never under mutex_.
  Status Reuse(TaskRef ref);
  // Whether the worker's memory is enough for the task, or no worker's is and it has as much as any.
  bool FitsLocked(TaskRef ref, const std::string& worker) const;
  // `waited_s`: how long the worker has asked already. `left_to_keepers`: whether there are only tasks that others have
  // the tiles of, which any worker that has not waited for long would leave to them too.
  std::optional<TaskRef> NextReadyLocked(const std::string& worker, double waited_s, bool& left_to_keepers);
  // What the task's worker is told; without threads.
  StatusOr<GrantedLease> DescribeLocked(TaskRef ref, int attempt) const;
  StatusOr<GrantedLease> GrantLocked(TaskRef ref, const std::string& worker);
  // The lease that this call was given before, if it is still current.
  StatusOr<std::optional<GrantedLease>> GrantedBeforeLocked(const std::string& worker, int64_t call);
  // --- lease_task.cc ---
  struct Look;
  Look LookLocked(const LeaseCall& call);
  // Never under mutex_.
  void Answer(LeaseCall call, Look look);
  void ServeWaiting();      // a thread: those that were woken, or are due
  void ServeWokenLocked();  // by that thread
  Status SeenLocked(const std::string& worker);
  // --- report_task.cc ---
  // What the calls of these names do; what follows is left to Settle.
  Status TakeSuccess(const std::string& worker, const std::string& task, int attempt, const ReportedResult& result);
  Status TakeFailure(const std::string& worker, const std::string& task, int attempt, const TaskFailure& failure);
  Status TakeLeave(const std::string& worker);
  Status Settle(const Status& taken);
  void Settle(const Status& taken, Done done);
  // Whether Advance has anything to do.
  bool AdvanceIsDueLocked();
  void AdvanceSoon();
  // Errors with Refusal::kNotCurrent.
  StatusOr<TaskRef> FindReportedLocked(const std::string& task) const;
  Status CheckCurrentLocked(TaskRef ref, const std::string& worker, int attempt);
  StatusOr<NewJob> CompleteRollback(NewJob job);
  StatusOr<std::optional<JobStatus>> FindRequestLocked(const JobRequest& request) const;
  JobStatus JobStatusLocked(int job) const;
  // The same, but without an end that is not stored yet.
  JobStatus StoredStatusLocked(int job) const;
  Status MayCreateJobLocked(const std::string& client) const;
  void ChangedLocked();
  // Workers are woken for `more` tasks, those in newly_ready() from `first` on by who has their tile.
  void WakeForLocked(int more, size_t first);

  // Does all that follows from the state without a worker: planning, reusing results, ending jobs.
  Status Advance();
  struct PendingStep;
  std::optional<PendingStep> NextStepLocked() const;
  // Jobs that are held begin as soon as what they are predicted to store fits the disk, beside what others are.
  void AdmitHeld();
  StatusOr<std::vector<PlannedTask>> PlanPhase(const PendingStep& step) const;
  // --- lost_results.cc ---
  // How it stands with a content that somebody could not read.
  struct Lost;
  // Ends an attempt whose worker could not read its inputs: those that are lost here too are made again.
  Status ReportLostInputs(const std::string& worker, const std::string& task, int attempt, TaskFailure failure);
  std::vector<Lost> LostInputsLocked(TaskRef ref, const std::set<std::string>& sha256) const;
  // Reads the content, and sets it aside if it is not what it was. Without lock, for it may take long.
  Status Examine(Lost& lost) const;
  // The task that made it is to run again, and `needed_by` is to wait: a task whose given output it is; with task -1
  // the plan of the job; none (job -1): nobody. FAILED_PRECONDITION if it cannot be made again. Needs blobs_mutex_ too,
  // shared, for its job may need all that it made again.
  Status RemakeLocked(TaskRef maker, const std::string& reason, TaskRef needed_by);
  // Those that the job's plan reads and cannot are made again; true if some are, and the job has to wait.
  StatusOr<bool> RemakeForPlan(const PendingStep& step);
  // Stores what the coordinator itself put into the job's plan. NOT_FOUND if it did not.
  Status RestorePlanned(int job, const Digest& digest);
  // A base's survey, which is needed at once: UNAVAILABLE while it is made again.
  StatusOr<std::string> ReadSurveyOf(const UpdateBase& base);
  void TellSetAsideLocked(const std::vector<SetAsideWorker>& workers);
  Status PlanJob(const PendingStep& step);
  Status EndJob(PendingStep step);
  // Of a job that has ended: the report as it was then, under its digest. NOT_FOUND if the digest is not that report's,
  // UNAVAILABLE while results are made again, FAILED_PRECONDITION if it was written by an earlier release.
  Status RestoreReport(int job, const Digest& digest);
  StatusOr<Digest> StoreReport(const PendingStep& step);
  std::vector<KnownTask> TasksFrom(const PendingStep& step) const;
  Status SetTileAside(const PendingStep& step);
  // `time_us`: of its end, which its report tells; 0: now.
  Status EndJobLocked(int job, JobState state, const std::string& error, const std::vector<NamedDigest>& artifacts,
                      int64_t time_us = 0);
  Status ReuseReady();

  const DispatchEnvironment environment_;
  const DispatchOptions options_;
  std::atomic<bool> advance_wanted_ = false;
  std::mutex advance_mutex_;  // one Advance at a time; taken before mutex_
  // Shared by who refers to blobs that may be stored already; taken before mutex_.
  std::shared_mutex blobs_mutex_;
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;  // what is shown
  std::condition_variable waiting_changed_;  // for ServeWaiting
  WaitingWorkers waiting_;
  LeaseCall::Time served_at_ = LeaseCall::Time::min();  // when ServeWaiting looks next
  Ledger ledger_;
  LeaseTable leases_;
  std::map<int, int64_t> end_records_;          // of jobs that ended: the record's number in the journal
  int64_t last_expiry_us_ = 0;                  // when it was last looked for leases that are over; 0: never
  mutable std::vector<double> shown_progress_;  // of each job, the furthest
  // What came to be referred to since CollectReferences: by records, and by jobs that run again.
  struct NewReferences {
    absl::flat_hash_set<uint64_t> blobs;  // BlobReferences::IdOf
    std::set<int> jobs;                   // whose outputs are all among these
  };
  std::optional<NewReferences> referred_since_;
  int next_worker_ = 1;
  int64_t version_ = 1;
  bool draining_ = false, stopped_ = false;
  Room room_;
  bool ends_ = false;
  DispatchCounts counts_;
  ChangedTasks changed_tasks_;  // of what the journal has yet to store
  Journal journal_;
  // They end first, in this order from below. What comes of calls is done by threads of its own, so that no call holds
  // up others.
  std::atomic<bool> advance_soon_ = false;
  WorkThread advance_thread_;
  WorkThread examine_thread_;
  std::thread waiting_thread_;
};

}  // namespace tessera

#endif  // TESSERA_SERVER_JOBS_DISPATCHER_H_
