// Blobs that were lost or damaged: quarantined, and made again by the task that made them, as far back as needed.
#pragma once

#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/jobs/pending_step.h"
#include "server/leases/dispatch_core.h"

namespace tessera {

// Thread-safe. Tasks and plans that need a lost result wait until it is there again. Calls hash files and may take
// long.
class Recovery {
 public:
  // `core` must outlive this.
  explicit Recovery(DispatchCore& core) : core_(core) {}

  // Ends an attempt whose worker could not read its inputs (failure.lost_inputs). Those that are lost or damaged here
  // too are made again. Refusal::kNotCurrent if the attempt is not the current one.
  Status ReportLostInputs(const std::string& worker, const std::string& task, int attempt, TaskFailure failure);
  // Has lost blobs that the step's plan reads made again; true if some are, and the job has to wait.
  // FAILED_PRECONDITION or NOT_FOUND if one cannot be made again.
  StatusOr<bool> RemakeForPlan(const PendingStep& step);
  // The survey of a base job. UNAVAILABLE while it is made again.
  StatusOr<std::string> ReadSurveyOf(const UpdateBase& base);
  // Has a file that a job published, and that is lost or damaged, made again. NOT_FOUND if no job published it; an
  // error with the reason if it cannot be made again. May be called again while it is made.
  Status RemakeArtifact(const Digest& digest);

 private:
  // A blob that a worker could not read.
  struct Lost;

  // Those named ...Locked need the core's mutex.
  std::vector<Lost> LostInputsLocked(TaskRef ref, const std::set<std::string>& sha256) const;
  // Hashes the blob, and quarantines it if its content has changed.
  Status Examine(Lost& lost) const;
  // The task `maker` is to run again, and `needed_by` is to wait: a task whose given output it made; with task -1 the
  // plan of the job; none (job -1): nobody. FAILED_PRECONDITION if it cannot be made again. Needs blob_use().mutex too,
  // shared, for the job may need all its outputs again.
  Status RemakeLocked(TaskRef maker, const std::string& reason, TaskRef needed_by);
  // Stores again what the coordinator itself put into the job's plan. NOT_FOUND if it did not.
  Status RestorePlanned(int job, const Digest& digest);
  // Stores the report of a job that has ended again. NOT_FOUND if the digest is not that report's, UNAVAILABLE while
  // results are made again, FAILED_PRECONDITION if an earlier release wrote it.
  Status RestoreReport(int job, const Digest& digest);

  DispatchCore& core_;
  const DispatchEnvironment& environment_ = core_.environment();
  const DispatchOptions& options_ = core_.options();
  std::mutex& mutex_ = core_.mutex();
  Ledger& ledger_ = core_.ledger();
};

}  // namespace tessera
