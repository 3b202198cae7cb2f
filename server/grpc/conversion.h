// Conversions between the coordinator's value types and the messages of tessera.v1. Include in .cc files only.
#pragma once

#include "server/admission/admission.h"
#include "server/auth/access.h"
#include "server/jobs/job_status.h"
#include "server/leases/leases.h"
#include "server/ledger/digest_proto.h"
#include "server/settings/setting_list.h"
#include "server/settings/settings_proto.h"
#include "server/tiles/tiles.h"
#include "tessera/v1/jobs.pb.h"
#include "tessera/v1/workers.pb.h"

namespace tessera {

Submission SubmissionOf(const v1::CreateJobRequest& request, const Caller& caller);
TaskFailure FromProto(const v1::TaskError& error);
ReportedResult FromProto(const v1::TaskResult& result);
void ToProto(const JobStatus& status, v1::Job* proto);
void ToProto(const TaskStatus& status, v1::Task* proto);
void ToProto(const AttemptStatus& status, v1::Attempt* proto);
void ToProto(const ListedTile& tile, v1::Tile* proto);
void ToProto(const ListedView& listed, v1::View* proto);
void ToProto(const PointOnMap& found, v1::LocatePointResponse* proto);
void ToProto(const ListedSetting& setting, v1::Setting* proto);
void ToProto(const JobQuote& quote, v1::Quote* proto);
// `shared_paths`: include the coordinator's paths of the inputs.
void ToProto(const GrantedLease& lease, bool shared_paths, v1::Lease* proto);

}  // namespace tessera
