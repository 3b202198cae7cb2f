#include "server/jobs/job_records.h"

#include "common/base/printable.h"
#include "server/ledger/digest_proto.h"
#include "tessera/v1/records.pb.h"

namespace tessera {

Status CommitEnd(DispatchCore& core, int job, JobState state, const std::string& error,
                 const std::vector<NamedDigest>& artifacts, int64_t time_us, bool bad_input) {
  v1::Record record;
  record.set_time_us(time_us);
  v1::JobEnded& ended = *record.mutable_job_ended();
  ended.set_job(core.ledger().jobs()[job].header.name);
  ended.set_state(static_cast<v1::JobState>(state));
  ended.set_error(AsUtf8(error));  // messages of libraries may not be UTF-8
  ended.set_bad_input(bad_input);
  AddFiles(artifacts, ended.mutable_artifacts());
  TESSERA_RETURN_IF_ERROR(core.Commit(record));
  core.lease_table().DropJob(job);  // workers stop after their next heartbeat
  return absl::OkStatus();
}

Status CommitDeletion(DispatchCore& core, const std::string& name, const std::string& reason) {
  TESSERA_ASSIGN_OR_RETURN(const int job, ParseJobName(name));
  const std::vector<Job>& jobs = core.ledger().jobs();
  if (job < static_cast<int>(jobs.size()) && jobs[job].deleted) return absl::OkStatus();
  v1::Record record;
  record.mutable_job_deleted()->set_job(name);
  record.mutable_job_deleted()->set_reason(reason);
  TESSERA_RETURN_IF_ERROR(core.Commit(record));
  core.lease_table().DropJob(job);  // leases of tasks that recompute results
  return absl::OkStatus();
}

}  // namespace tessera
