// Results that an update takes from its base jobs.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/plan/update_base.h"

namespace tessera {

class Ledger;
struct UpdateSettings;

// The job as base of an update; the survey is not read. FAILED_PRECONDITION with what to do if the job has not
// succeeded, published nothing or is of another algorithm version.
StatusOr<UpdateBase> BaseOf(const Ledger& ledger, const std::string& job);
// The same for an update with these settings; tiles to roll back have the states of `update.rollback_to`. The base of
// an export may be partial.
StatusOr<UpdateBase> BaseOf(const Ledger& ledger, const UpdateSettings& update);
// BaseOf each job on the chain of bases from `job` to `earlier`. INVALID_ARGUMENT with the chain if it lacks
// `earlier`.
StatusOr<std::vector<UpdateBase>> ChainTo(const Ledger& ledger, const std::string& job, const std::string& earlier);

}  // namespace tessera
