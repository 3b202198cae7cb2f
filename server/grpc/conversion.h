// Conversions between the coordinator's value types and the messages of tessera.v1. Include in .cc files only.
#pragma once

#include "server/jobs/job_status.h"
#include "server/leases/leases.h"
#include "server/ledger/digest_proto.h"
#include "server/settings/settings_proto.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/workers.pb.h"

namespace tessera {

TaskFailure FromProto(const v1::TaskError& error);
ReportedResult FromProto(const v1::TaskResult& result);
void ToProto(const JobStatus& status, v1::Job* proto);
void ToProto(const TaskStatus& status, v1::Task* proto);
void ToProto(const AttemptStatus& status, v1::Attempt* proto);
// `shared_paths`: include the coordinator's paths of the inputs.
void ToProto(const GrantedLease& lease, bool shared_paths, v1::Lease* proto);

}  // namespace tessera
