#include "server/jobs/jobs.h"

#include <algorithm>
#include <shared_mutex>
#include <utility>

#include "common/base/printable.h"
#include "common/base/refusal.h"
#include "common/base/version.h"
#include "server/jobs/job_records.h"
#include "server/jobs/waiting_for.h"
#include "server/leases/job_limits.h"
#include "server/ledger/check_record.h"
#include "server/ledger/digest_proto.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/records.pb.h"

namespace tessera {
namespace {

// ALREADY_EXISTS with the differences if the job of the same request id was submitted with other values.
Status CheckSameRequest(const JobRequest& request, const JobHeader& job) {
  if (!job.request) return absl::OkStatus();
  std::vector<std::string> differences = Differences(request.settings, job.request->settings);
  if (request.scene_path != job.request->scene_path) {
    differences.push_back("scene_path: found " + request.scene_path + ", expected " + job.request->scene_path);
  }
  if (differences.empty()) return absl::OkStatus();
  std::string message = "request " + request.id + " was used for " + job.name + " with other values:";
  for (const std::string& difference : differences) message += "\n" + difference;
  return absl::AlreadyExistsError(message);
}

}  // namespace

JobStatus Jobs::JobStatusLocked(int job, size_t max_artifacts) const {
  const int64_t now_us = environment_.clock->MonotonicUs();
  JobStatus status = StatusOfJob(ledger_.jobs()[job], job, leases_, now_us, max_artifacts);
  status.stage = StageText(ledger_, job, leases_);
  status.waiting_for = WaitingFor(ledger_, job, leases_, core_.journal().trouble(), planning_.room(), now_us);
  // A failed attempt loses its progress, but the displayed progress must not decrease.
  if (shown_progress_.size() < ledger_.jobs().size()) shown_progress_.resize(ledger_.jobs().size());
  status.progress = shown_progress_[job] = std::max(status.progress, shown_progress_[job]);
  return status;
}

Status Jobs::MayCreateJobLocked(const std::string& client) const {
  if (core_.draining()) return DrainingError("accepts no jobs");
  return CheckJobLimits(ledger_, client, options_.limits);
}

Status Jobs::MayCreateJob(const std::string& client) const {
  std::lock_guard lock(mutex_);
  return MayCreateJobLocked(client);
}

StatusOr<JobStatus> Jobs::CreateJob(const NewJob& asked) {
  TESSERA_ASSIGN_OR_RETURN(const NewJob job, CompleteJob(asked));
  v1::Record record;
  v1::JobAccepted& accepted = *record.mutable_job_accepted();
  if (!job.request.id.empty()) {
    accepted.set_request_id(job.request.id);
    accepted.mutable_request()->set_scene_path(job.request.scene_path);
    ToProto(job.request.settings, accepted.mutable_request()->mutable_settings());
  }
  accepted.set_display_name(job.display_name);
  accepted.set_scene_path(job.scene_path);
  ToProto(job.settings, accepted.mutable_settings());
  for (const NamedDigest& file : job.scene_files) {
    v1::SceneFileRecord& added = *accepted.add_scene_files();
    added.set_path(file.name);
    ToProto(file.digest, added.mutable_digest());
  }
  for (const std::string& warning : job.warnings) accepted.add_warnings(AsUtf8(warning));
  accepted.set_algorithm_version(kAlgorithmVersion);
  accepted.set_priority(job.priority);
  accepted.set_client(job.client);
  std::optional<JobStatus> known;
  int index = -1;
  {
    const std::shared_lock refers(core_.blob_use().mutex);
    if (!job.classifier.empty()) TESSERA_RETURN_IF_ERROR(environment_.blobs->PutBytes(job.classifier).status());
    std::lock_guard lock(mutex_);
    TESSERA_ASSIGN_OR_RETURN(known, FindRequestLocked(job.request));
    if (!known) {
      TESSERA_RETURN_IF_ERROR(MayCreateJobLocked(job.client));
      // They may have been deleted since the job was completed.
      for (const std::string& name : {job.settings.update.base, job.settings.update.rollback_to}) {
        if (!name.empty()) TESSERA_RETURN_IF_ERROR(ledger_.FindJob(name).status());
      }
      index = static_cast<int>(ledger_.jobs().size());
      accepted.set_job(JobName(index));
      TESSERA_RETURN_IF_ERROR(core_.Commit(record));
    }
  }
  TESSERA_RETURN_IF_ERROR(core_.Durable());
  if (known) return *std::move(known);
  // The job is accepted even if this fails; Tick retries and reports the error.
  planning_.Advance().IgnoreError();
  std::lock_guard lock(mutex_);
  return JobStatusLocked(index);
}

StatusOr<std::optional<JobStatus>> Jobs::FindRequest(const JobRequest& request) const {
  std::optional<JobStatus> known;
  {
    std::lock_guard lock(mutex_);
    TESSERA_ASSIGN_OR_RETURN(known, FindRequestLocked(request));
  }
  if (known) TESSERA_RETURN_IF_ERROR(core_.Durable());  // the creating call may still wait for durability
  return known;
}

StatusOr<std::optional<JobStatus>> Jobs::FindRequestLocked(const JobRequest& request) const {
  const auto found = ledger_.job_of_request().find(request.id);
  if (found == ledger_.job_of_request().end()) return std::nullopt;
  TESSERA_RETURN_IF_ERROR(CheckSameRequest(request, ledger_.jobs()[found->second].header));
  return JobStatusLocked(found->second);
}

StatusOr<JobStatus> Jobs::CancelJob(const std::string& name) {
  {
    std::lock_guard lock(mutex_);
    TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
    if (!HasEnded(ledger_.jobs()[job].header.state)) {
      TESSERA_RETURN_IF_ERROR(CommitEnd(core_, job, JobState::kCancelled, "cancelled", {}));
    }
  }
  return GetJob(name);
}

StatusOr<JobStatus> Jobs::ChangeJob(const std::string& name, const JobChange& change) {
  {
    std::lock_guard lock(mutex_);
    v1::Record record;
    v1::JobChanged& changed = *record.mutable_job_changed();
    changed.set_job(name);
    if (change.priority) changed.set_priority(*change.priority);
    if (change.paused) changed.set_paused(*change.paused);
    TESSERA_RETURN_IF_ERROR(core_.Commit(record));
  }
  TESSERA_RETURN_IF_ERROR(core_.Durable());
  return GetJob(name);
}

StatusOr<JobStatus> Jobs::RetryJob(const std::string& name, std::optional<int> tile) {
  {
    const std::shared_lock refers(core_.blob_use().mutex);
    std::lock_guard lock(mutex_);
    if (core_.draining()) return DrainingError("accepts no jobs");
    TESSERA_ASSIGN_OR_RETURN(const int job, ledger_.FindJob(name));
    TESSERA_RETURN_IF_ERROR(ledger_.CheckVersion(job, "submit its scene again"));
    v1::Record record;
    record.mutable_job_retried()->set_job(name);
    if (tile) record.mutable_job_retried()->set_tile(*tile);
    TESSERA_RETURN_IF_ERROR(CheckRecord(ledger_, record));
    TESSERA_RETURN_IF_ERROR(CheckActiveJobLimits(ledger_, ledger_.jobs()[job].header.client, options_.limits));
    TESSERA_RETURN_IF_ERROR(core_.Commit(record));
    if (job < static_cast<int>(shown_progress_.size())) shown_progress_[job] = 0;
  }
  TESSERA_RETURN_IF_ERROR(core_.Durable());
  planning_.Advance().IgnoreError();  // Tick retries and reports the error
  return GetJob(name);
}

Status Jobs::DeleteJob(const std::string& name, const std::string& reason) {
  {
    std::lock_guard lock(mutex_);
    TESSERA_RETURN_IF_ERROR(CommitDeletion(core_, name, reason));
  }
  return core_.Durable();
}

}  // namespace tessera
