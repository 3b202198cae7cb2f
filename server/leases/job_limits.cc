#include "server/leases/job_limits.h"

#include <algorithm>
#include <vector>

#include "common/base/refusal.h"
#include "server/leases/lease_table.h"
#include "server/ledger/ledger.h"

namespace tessera {

Status CheckActiveJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits) {
  constexpr char kWait[] = "wait until some end, or cancel some";
  const std::vector<int>& active = ledger.active_jobs();
  if (std::count_if(active.begin(), active.end(),
                    [&](int job) { return ledger.jobs()[job].header.client == client; }) >= limits.of_client) {
    return LimitError({"jobs of '" + client + "' that are active", limits.of_client, "--max-jobs-of-client"}, kWait);
  }
  if (static_cast<int>(active.size()) >= limits.in_all) {
    return LimitError({"active jobs", limits.in_all, "--max-jobs"}, kWait);
  }
  return absl::OkStatus();
}

Status CheckJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits) {
  TESSERA_RETURN_IF_ERROR(CheckActiveJobLimits(ledger, client, limits));
  if (std::count_if(ledger.jobs().begin(), ledger.jobs().end(), [](const Job& job) { return !job.deleted; }) >=
      limits.kept) {
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
