// Jobs as users create, change and see them.
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

// Thread-safe. Calls that change a job return OK once the change is durable, UNAVAILABLE if that takes too long: the
// change stands, and the call may be repeated. On other errors nothing changed. NOT_FOUND for a job that does not
// exist.
class Jobs {
 public:
  // All must outlive this.
  Jobs(DispatchCore& core, PlanningLoop& planning, Recovery& recovery)
      : core_(core), planning_(planning), recovery_(recovery) {}

  // The job as it would be accepted, see complete_job.h. Changes nothing.
  StatusOr<NewJob> CompleteJob(NewJob job) { return tessera::CompleteJob(core_, recovery_, std::move(job)); }
  // A request whose id was used returns the job of that request; ALREADY_EXISTS with all differences, a line each, if
  // that was for another scene or other settings. Errors of MayCreateJob and CompleteJob.
  StatusOr<JobStatus> CreateJob(const NewJob& job);
  // RESOURCE_EXHAUSTED if the client, or all together, have as many jobs as they may; UNAVAILABLE while draining.
  Status MayCreateJob(const std::string& client) const;
  // None if no job has the id.
  StatusOr<std::optional<JobStatus>> FindRequest(const JobRequest& request) const;
  StatusOr<JobStatus> GetJob(const std::string& name) const;
  // Newest first: those before `before` (a job's index; -1: from the newest), at most `count`. Does not wait for
  // durability: an end that is not durable yet is not shown.
  std::vector<JobStatus> ListJobs(int before, int count) const;
  // The job as ListJobs shows it, and at most so many of its tasks that run.
  StatusOr<WatchedJob> WatchJob(const std::string& job, size_t max_running) const;

  StatusOr<JobStatus> CancelJob(const std::string& name);
  // FAILED_PRECONDITION if the job has ended; INVALID_ARGUMENT for a priority out of its range.
  StatusOr<JobStatus> ChangeJob(const std::string& name, const JobChange& change);
  // Lets a job that failed or ended partially continue; with a tile, only what failed of that tile.
  // FAILED_PRECONDITION with the reason if that is not possible.
  StatusOr<JobStatus> RetryJob(const std::string& name, std::optional<int> tile);
  // Deletes a job that has ended: nothing of it is shown or used again. FAILED_PRECONDITION, with what to do, if it has
  // not ended or is the base of another job. OK if it was deleted before. `reason`: for the log.
  Status DeleteJob(const std::string& name, const std::string& reason);

  // Tasks [first, first + count) in the plan's order.
  StatusOr<std::vector<TaskStatus>> ListTasks(const std::string& job, int first, int count) const;
  // At most `count` attempts from attempt `number` of task `first` on; fewer, or none, where many tasks have none.
  StatusOr<AttemptPage> ListAttempts(const std::string& job, int first, int number, int count) const;
  StatusOr<std::vector<TaskStatus>> RunningTasks(const std::string& job) const;

  // Blob authorization: whether readers of jobs may read the blob. A job published it, or it is a job's survey.
  bool IsPublished(const Digest& digest) const;
  // Absolute paths where scene files of jobs had this content when the jobs were accepted, the oldest job's first.
  std::vector<std::string> SceneFilesWith(const Digest& digest) const;

 private:
  // They need the core's mutex.
  StatusOr<std::optional<JobStatus>> FindRequestLocked(const JobRequest& request) const;
  Status MayCreateJobLocked(const std::string& client) const;
  JobStatus JobStatusLocked(int job) const;
  // The same, but without an end that is not durable yet.
  JobStatus StoredStatusLocked(int job) const;

  DispatchCore& core_;
  PlanningLoop& planning_;
  Recovery& recovery_;
  const DispatchEnvironment& environment_ = core_.environment();
  const DispatchOptions& options_ = core_.options();
  std::mutex& mutex_ = core_.mutex();
  Ledger& ledger_ = core_.ledger();
  LeaseTable& leases_ = core_.lease_table();
  mutable std::vector<double> shown_progress_;  // of each job, the furthest
};

}  // namespace tessera
