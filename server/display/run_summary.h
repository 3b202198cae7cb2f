// What a finished run tells its user.
#ifndef TESSERA_SERVER_DISPLAY_RUN_SUMMARY_H_
#define TESSERA_SERVER_DISPLAY_RUN_SUMMARY_H_

#include <string>
#include <vector>

namespace tessera {

// Lines about the results in `out`, from its report.json and job.json as far as they are there: faces, tiles, energy,
// labels changed, what was reused.
std::vector<std::string> RunSummary(const std::string& out);

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPLAY_RUN_SUMMARY_H_
