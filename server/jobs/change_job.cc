// What users change of a job that was accepted.
#include "common/base/refusal.h"
#include "server/jobs/dispatcher.h"
#include "server/leases/job_limits.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

StatusOr<JobStatus> Dispatcher::ChangeJob(const std::string& name, const JobChange& change) {
  {
    std::lock_guard lock(mutex_);
    v1::Record record;
    v1::JobChanged& changed = *record.mutable_job_changed();
    changed.set_job(name);
    if (change.priority) changed.set_priority(*change.priority);
    if (change.paused) changed.set_paused(*change.paused);
    TESSERA_RETURN_IF_ERROR(CommitLocked(record));
  }
  TESSERA_RETURN_IF_ERROR(Durable());
  return GetJob(name);
}

StatusOr<JobStatus> Dispatcher::RetryJob(const std::string& name, std::optional<int> tile) {
  {
    const std::shared_lock refers(blobs_mutex_);
    std::lock_guard lock(mutex_);
    if (draining_) return DrainingError("accepts no jobs");
    TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
    TESSERA_RETURN_IF_ERROR(ledger_.CheckVersion(job, "submit its scene again"));
    v1::Record record;
    record.mutable_job_retried()->set_job(name);
    if (tile) record.mutable_job_retried()->set_tile(*tile);
    TESSERA_RETURN_IF_ERROR(ledger_.Check(record));
    TESSERA_RETURN_IF_ERROR(CheckActiveJobLimits(ledger_, ledger_.jobs()[job].header.client, options_.limits));
    TESSERA_RETURN_IF_ERROR(CommitLocked(record));
    if (job < static_cast<int>(shown_progress_.size())) shown_progress_[job] = 0;
  }
  TESSERA_RETURN_IF_ERROR(Durable());
  Advance().IgnoreError();  // Tick tries again and tells
  return GetJob(name);
}

}  // namespace tessera
