#include "server/leases/job_limits.h"

#include "common/base/refusal.h"
#include "server/leases/lease_table.h"
#include "server/ledger/ledger.h"

namespace tessera {

Status CheckActiveJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits) {
  constexpr char kWait[] = "wait until some have ended, or cancel some";
  if (ledger.ActiveJobsOf(client) >= limits.of_client) {
    return LimitError({"jobs of '" + client + "' that have not ended", limits.of_client, "--max-jobs-of-client"},
                      kWait);
  }
  if (static_cast<int>(ledger.active_jobs().size()) >= limits.in_all) {
    return LimitError({"jobs that have not ended", limits.in_all, "--max-jobs"}, kWait);
  }
  return absl::OkStatus();
}

Status CheckJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits) {
  TESSERA_RETURN_IF_ERROR(CheckActiveJobLimits(ledger, client, limits));
  if (ledger.kept_jobs() >= limits.kept) {
    return LimitError({"jobs that are kept", limits.kept, "--max-kept-jobs"},
                      "delete some, or have it done (--keep-days)");
  }
  return absl::OkStatus();
}

Status CheckWorkerLimits(const LeaseTable& leases, const std::string& client, const WorkerLimits& limits) {
  constexpr char kWait[] = "end some, or wait until those that fell silent are forgotten";
  if (leases.WorkersOf(client) >= limits.of_client) {
    return LimitError({"workers of '" + client + "'", limits.of_client, "--max-workers-of-client"}, kWait);
  }
  if (static_cast<int>(leases.workers().size()) >= limits.in_all) {
    return LimitError({"workers", limits.in_all, "--max-workers"}, kWait);
  }
  return absl::OkStatus();
}

}  // namespace tessera
