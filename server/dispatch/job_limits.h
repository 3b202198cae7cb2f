// How many jobs a coordinator takes.
#ifndef TESSERA_SERVER_DISPATCH_JOB_LIMITS_H_
#define TESSERA_SERVER_DISPATCH_JOB_LIMITS_H_

#include <string>

#include "common/base/status.h"

namespace tessera {

class Ledger;

struct JobLimits {
  int of_client = 1000;  // that have not ended, of one client
  int in_all = 10'000;   // that have not ended
  int kept = 100'000;    // ended ones too, until they are deleted
};

// OK if one more job of the client may go on that has ended, else RESOURCE_EXHAUSTED with the limit (Refusal::kLimit).
Status CheckActiveJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits);
// The same for a new job.
Status CheckJobLimits(const Ledger& ledger, const std::string& client, const JobLimits& limits);

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPATCH_JOB_LIMITS_H_
