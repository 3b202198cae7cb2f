// Chrome trace of a job's attempts.
#pragma once

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

// Chrome trace event format (chrome://tracing, ui.perfetto.dev): one process per machine, one track per worker, one
// slice per attempt, in microseconds since submission. Attempts of a worker that overlap in time are on several tracks.
// Running attempts of a job that has not ended end at `now_us` (Unix time).
std::string TimelineJson(const v1::Job& job, std::vector<v1::Attempt> attempts, int64_t now_us);

// Writes the trace of a job of the coordinator, in any state, to `path`.
Status WriteTimeline(Connection& connection, const std::string& job, const Clock& clock, const std::string& path);

}  // namespace tessera
