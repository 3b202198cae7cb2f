// Commits records that end or delete a job. Both functions need the core's mutex.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/leases/dispatch_core.h"

namespace tessera {

// Ends the job and its leases. `time_us`: the end as in the job's report; 0: now. `bad_input`: as in JobHeader.
Status CommitEnd(DispatchCore& core, int job, JobState state, const std::string& error,
                 const std::vector<NamedDigest>& artifacts, int64_t time_us = 0,
                 bool bad_input = false);
// OK if the job was already deleted. `reason`: for the log.
Status CommitDeletion(DispatchCore& core, const std::string& name, const std::string& reason);

}  // namespace tessera
