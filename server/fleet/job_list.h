// Reads what a scheduler's `list` command prints.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "server/fleet/fleet_file.h"
#include "server/fleet/pilot.h"

namespace tessera {

// All functions: INVALID_ARGUMENT if the text is not a complete list; jobs of other names are left out.

// The output of `squeue --json`, of Slurm 22.05 and later: numbers may be objects {set, infinite, number}, states
// lists. Only jobs of the user (`user_id`). A list with errors is refused: squeue prints an empty list and ends with
// exit code 0 if the controller does not answer. One pilot for each element of an array.
StatusOr<std::vector<Pilot>> ParseSlurmJobs(const std::string& text, const FleetFile& fleet, int64_t user_id);

// {"jobs": [{"id": "17", "name": "tessera.city.small", "state": "pending", ...}, ...]} of other schedulers.
// Required: id, name and state (pending, running, succeeded, failed, or cancelled if the scheduler or a user ended it).
// Optional: allocation (of the worker, if it is not the id), reason and output (texts); submitted, started and ended
// (Unix time, seconds). Jobs that ended less than ten minutes ago should be listed.
StatusOr<std::vector<Pilot>> ParseJobList(const std::string& text, const FleetFile& fleet);

}  // namespace tessera
