// How many jobs and workers a coordinator accepts.
#pragma once

#include <string>

#include "common/base/status.h"

namespace tessera {

class LeaseTable;
class Ledger;

struct JobLimits {
  int of_client = 1000;  // that have not ended, of one client
  int in_all = 10'000;   // that have not ended
  int kept = 100'000;    // ended ones too, until they are deleted
};

// Workers that are registered and were not forgotten.
struct WorkerLimits {
  int of_client = 10'000;
  int in_all = 20'000;
};

// OK if one more ended job of the client may be retried, else RESOURCE_EXHAUSTED with the limit (Refusal::kLimit).
Status CheckActiveJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits);
// The same for a new job.
Status CheckJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits);
// The same for a new worker.
Status CheckWorkerLimits(const LeaseTable& leases, const std::string& client, const WorkerLimits& limits);

}  // namespace tessera
