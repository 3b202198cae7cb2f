// Jobs for users: create, change, list and delete them.
#pragma once

#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/jobs/complete_job.h"
#include "server/jobs/job_status.h"
#include "server/jobs/planning_loop.h"
#include "server/jobs/recovery.h"
#include "server/leases/dispatch_core.h"

namespace tessera {

// A survey and the job that made it.
struct KnownSurvey {
  std::string job;
  Digest survey;
};

// Thread-safe. Calls that change a job return OK when the change is durable, UNAVAILABLE if that takes too long: the
// change stays, and the call may be repeated. On other errors nothing changes. NOT_FOUND for an unknown job.
class Jobs {
 public:
  // All arguments must outlive this.
  Jobs(DispatchCore& core, PlanningLoop& planning, Recovery& recovery)
      : core_(core), planning_(planning), recovery_(recovery) {}

  // See complete_job.h. Changes nothing.
  StatusOr<NewJob> CompleteJob(NewJob job) { return tessera::CompleteJob(core_, recovery_, std::move(job)); }
  // If the request id exists, returns its job, or ALREADY_EXISTS with one line per difference if the scene or settings
  // differ. Errors as MayCreateJob and CompleteJob.
  StatusOr<JobStatus> CreateJob(const NewJob& job);
  // RESOURCE_EXHAUSTED at a limit of the client or of all clients; UNAVAILABLE while draining.
  Status MayCreateJob(const std::string& client) const;
  // None if no job has the id.
  StatusOr<std::optional<JobStatus>> FindRequest(const JobRequest& request) const;
  StatusOr<JobStatus> GetJob(const std::string& name) const;
  // At most `count` jobs below index `before` (-1: all), newest first, without their artifacts. Does not wait for
  // durability: shows an end only when it is durable.
  std::vector<JobStatus> ListJobs(int before, int count) const;
  // The job as in ListJobs, with its artifacts and at most `max_running` of its running tasks.
  StatusOr<WatchedJob> WatchJob(const std::string& job, size_t max_running) const;

  StatusOr<JobStatus> CancelJob(const std::string& name);
  // FAILED_PRECONDITION if the job has ended; INVALID_ARGUMENT if the priority is out of range.
  StatusOr<JobStatus> ChangeJob(const std::string& name, const JobChange& change);
  // Continues a failed or partial job; with `tile`, only the failed tasks of that tile. FAILED_PRECONDITION with the
  // reason if that is not possible.
  StatusOr<JobStatus> RetryJob(const std::string& name, std::optional<int> tile);
  // Deletes an ended job and its results. FAILED_PRECONDITION with what to do if it is active or the base of another
  // job. OK if it was already deleted. `reason`: for the log.
  Status DeleteJob(const std::string& name, const std::string& reason);

  // Tasks [first, first + count) in the order of the plan.
  StatusOr<std::vector<TaskStatus>> ListTasks(const std::string& job, int first, int count) const;
  // At most `count` attempts from attempt `number` of task `first`. With `tile`, only those of its tasks.
  // A page may be short or empty if tasks have none.
  StatusOr<AttemptPage> ListAttempts(const std::string& job, int first, int number, int count,
                                     std::optional<int> tile = std::nullopt) const;
  // At most `count` published files whose names start with `prefix`, in the order of publication from index `first`. A
  // page may be short or empty although another one follows.
  StatusOr<ArtifactPage> ListArtifacts(const std::string& job, const std::string& prefix, int first, int count) const;
  // The newest stored survey of a job whose first phase reads the same files in the same way as that of `job`, of this
  // algorithm version. Looks at the last 1,000 jobs.
  std::optional<KnownSurvey> FindSurvey(const NewJob& job) const;
  StatusOr<std::vector<TaskStatus>> RunningTasks(const std::string& job) const;

  // Blob authorization: users may read the artifacts and surveys of jobs.
  bool IsPublished(const Digest& digest) const;
  // See Ledger::SceneFilesWith.
  std::vector<std::string> SceneFilesWith(const Digest& digest) const;

 private:
  // Functions named ...Locked need the core's mutex.
  StatusOr<std::optional<JobStatus>> FindRequestLocked(const JobRequest& request) const;
  Status MayCreateJobLocked(const std::string& client) const;
  JobStatus JobStatusLocked(int job, size_t max_artifacts = kMaxShownArtifacts) const;
  // The same, without an end that is not durable yet.
  JobStatus StoredStatusLocked(int job, size_t max_artifacts = kMaxShownArtifacts) const;

  DispatchCore& core_;
  PlanningLoop& planning_;
  Recovery& recovery_;
  const DispatchEnvironment& environment_ = core_.environment();
  const DispatchOptions& options_ = core_.options();
  std::mutex& mutex_ = core_.mutex();
  Ledger& ledger_ = core_.ledger();
  LeaseTable& leases_ = core_.lease_table();
  mutable std::vector<double> shown_progress_;  // by job: highest progress shown
};

}  // namespace tessera
