// Limits on the number of jobs and workers.
#pragma once

#include <string>

#include "common/base/status.h"

namespace tessera {

class LeaseTable;
class Ledger;

struct JobLimits {
  int of_client = 1000;  // active jobs of one client
  int in_all = 10'000;   // active jobs
  int kept = 100'000;    // active and ended jobs, until deleted
};

struct WorkerLimits {
  int of_client = 10'000;
  int in_all = 20'000;
};

// Whether the client may have one more active job; else RESOURCE_EXHAUSTED with the limit (Refusal::kLimit).
Status CheckActiveJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits);
// The same for a new job.
Status CheckJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits);
// The same for a new worker.
Status CheckWorkerLimits(const LeaseTable& leases, const std::string& client, const WorkerLimits& limits);

}  // namespace tessera
