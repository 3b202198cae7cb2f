// job.json: how a job went, for its user.
#ifndef TESSERA_SERVER_DISPATCH_JOB_REPORT_H_
#define TESSERA_SERVER_DISPATCH_JOB_REPORT_H_

#include <string>

#include "server/dispatch/job.h"

namespace tessera {

// JSON with the job, its settings, every task (attempts, workers, seconds, key, what it reported) and totals. `end_us`:
// when it ended (Unix time); `error`: empty if it succeeded.
std::string JobReportJson(const Job& job, const std::string& error, int64_t end_us);

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPATCH_JOB_REPORT_H_
