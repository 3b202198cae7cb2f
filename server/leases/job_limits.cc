#include "server/leases/job_limits.h"

#include "common/base/refusal.h"
#include "server/leases/lease_table.h"
#include "server/ledger/ledger.h"

namespace tessera {

Status CheckActiveJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits) {
  constexpr char kWait[] = "wait until some end, or cancel some";
  if (ledger.ActiveJobsOf(client) >= limits.of_client) {
    return LimitError({"jobs of '" + client + "' that are active", limits.of_client, "--max-jobs-of-client"}, kWait);
  }
  if (static_cast<int>(ledger.active_jobs().size()) >= limits.in_all) {
    return LimitError({"active jobs", limits.in_all, "--max-jobs"}, kWait);
  }
  return absl::OkStatus();
}

Status CheckJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits) {
  TESSERA_RETURN_IF_ERROR(CheckActiveJobLimits(ledger, client, limits));
  if (ledger.kept_jobs() >= limits.kept) {
    return LimitError({"stored jobs", limits.kept, "--max-kept-jobs"}, "delete some, or set --keep-days");
  }
  return absl::OkStatus();
}

Status CheckWorkerLimits(const LeaseTable& leases, const std::string& client, const WorkerLimits& limits) {
  constexpr char kWait[] = "stop some, or wait until silent ones are removed";
  if (leases.WorkersOf(client) >= limits.of_client) {
    return LimitError({"workers of '" + client + "'", limits.of_client, "--max-workers-of-client"}, kWait);
  }
  if (static_cast<int>(leases.workers().size()) >= limits.in_all) {
    return LimitError({"workers", limits.in_all, "--max-workers"}, kWait);
  }
  return absl::OkStatus();
}

}  // namespace tessera
