// Lists of strings that an error carries beside its message, as payloads of absl::Status.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// Stores `parts` under `kind`. An OK status stays unchanged.
void SetParts(Status& error, const std::string& kind, const std::vector<std::string>& parts);
// The parts stored under `kind`; empty if there are none.
std::vector<std::string> PartsOf(const Status& status, const std::string& kind);

}  // namespace tessera
