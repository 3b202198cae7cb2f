// Summary of a finished run.
#pragma once

#include <string>
#include <vector>

namespace tessera {

// Lines about the results in `out`, from its report.json and job.json if present: faces, tiles, energy, changed labels,
// reused tasks.
std::vector<std::string> RunSummary(const std::string& out);

}  // namespace tessera
