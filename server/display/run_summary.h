// Summary of a finished run.
#pragma once

#include <string>
#include <vector>

namespace tessera {

// Lines about the results in `out`, from its report.json and job.json if present: faces, tiles, energy, fit, changed
// labels, reused tasks.
std::vector<std::string> RunSummary(const std::string& out);

// Whether report.json in `out` says that the result fits the images worse than the start.
bool ResultIsWorse(const std::string& out);

}  // namespace tessera
