// Summary of a finished run.
#ifndef TESSERA_SERVER_DISPLAY_RUN_SUMMARY_H_
#define TESSERA_SERVER_DISPLAY_RUN_SUMMARY_H_

#include <string>
#include <vector>

namespace tessera {

// Lines about the results in `out`, from its report.json and job.json if present: faces, tiles, energy, changed labels,
// reused tasks.
std::vector<std::string> RunSummary(const std::string& out);

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPLAY_RUN_SUMMARY_H_
