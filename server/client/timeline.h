// A job's attempts over time, as a file that trace viewers open.
#ifndef TESSERA_SERVER_CLIENT_TIMELINE_H_
#define TESSERA_SERVER_CLIENT_TIMELINE_H_

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/clock.h"
#include "common/base/status.h"
#include "server/client/connection.h"

namespace tessera {

namespace v1 {
class Attempt;
class Job;
}  // namespace v1

// In Chrome's trace event format (chrome://tracing, ui.perfetto.dev): a process a machine, a row a worker, a slice an
// attempt, in microseconds since the job was submitted. What a worker did at the same time, as it seemed to the
// coordinator, is in several rows. Attempts that run yet, of a job that has not ended, end at `now_us` (Unix time).
std::string TimelineJson(const v1::Job& job, std::vector<v1::Attempt> attempts, int64_t now_us);

// Writes that of a job of the coordinator, whatever its state, to `path`.
Status WriteTimeline(Connection& connection, const std::string& job, const Clock& clock, const std::string& path);

}  // namespace tessera

#endif  // TESSERA_SERVER_CLIENT_TIMELINE_H_
