// Lists of strings that an error carries beside its message, as payloads of absl::Status.
#ifndef TESSERA_COMMON_BASE_STATUS_PARTS_H_
#define TESSERA_COMMON_BASE_STATUS_PARTS_H_

#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Stores `parts` under `kind`. An OK status stays unchanged.
void SetParts(Status& error, const std::string& kind, const std::vector<std::string>& parts);
// The parts stored under `kind`; empty if there are none.
std::vector<std::string> PartsOf(const Status& status, const std::string& kind);

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_STATUS_PARTS_H_
