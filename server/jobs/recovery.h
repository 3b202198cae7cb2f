// Recovery of lost or damaged blobs: quarantines them and reruns the tasks that made them, as far back as needed.
#pragma once

#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/jobs/pending_step.h"
#include "server/leases/dispatch_core.h"

namespace tessera {

// Tasks and plans that need a lost result wait until it is recomputed. Thread-safe. Calls hash files and may take long.
class Recovery {
 public:
  // `core` must outlive this.
  explicit Recovery(DispatchCore& core) : core_(core) {}

  // Ends an attempt whose worker could not read its inputs (failure.lost_inputs). Has inputs recomputed that are also
  // lost or damaged here. Refusal::kNotCurrent if the attempt is not the current one.
  Status ReportLostInputs(const std::string& worker, const std::string& task, int attempt, TaskFailure failure);
  // Has lost blobs recomputed that planning the step needs. Returns whether the job must wait for some.
  // FAILED_PRECONDITION or NOT_FOUND if one cannot be recomputed.
  StatusOr<bool> RemakeForPlan(const PendingStep& step);
  // The survey of a base job. UNAVAILABLE while it is recomputed.
  StatusOr<std::string> ReadSurveyOf(const UpdateBase& base);
  // Has a lost or damaged artifact of a job recomputed. NOT_FOUND if no job published it; another error with the reason
  // if it cannot be recomputed. May be called repeatedly meanwhile.
  Status RemakeArtifact(const Digest& digest);

 private:
  // A blob that a worker could not read.
  struct Lost;

  // Functions named ...Locked need the core's mutex.
  std::vector<Lost> LostInputsLocked(TaskRef ref, const std::set<std::string>& sha256) const;
  // Hashes the input; quarantines a blob whose content has changed.
  Status Examine(Lost& lost) const;
  // Commits that `maker` runs again and that `needed_by` waits for it: a task whose outputs were taken from the base
  // job, or (task -1) the planning of a job, or (job -1) nothing. FAILED_PRECONDITION if it cannot be recomputed. Also
  // needs blob_use().mutex, shared, because the job may need all its outputs again.
  Status RemakeLocked(TaskRef maker, const std::string& reason, TaskRef needed_by);
  // Stores again a file that the planner itself made for the job. NOT_FOUND if it is no such file.
  Status RestorePlanned(int job, const Digest& digest);
  // Stores again job.json of an ended job. NOT_FOUND if the digest is of another file; UNAVAILABLE while
  // results are recomputed; FAILED_PRECONDITION if an earlier release wrote it.
  Status RestoreReport(int job, const Digest& digest);

  DispatchCore& core_;
  const DispatchEnvironment& environment_ = core_.environment();
  const DispatchOptions& options_ = core_.options();
  std::mutex& mutex_ = core_.mutex();
  Ledger& ledger_ = core_.ledger();
};

}  // namespace tessera
