// Strings that travel with an error, beside its message.
#ifndef TESSERA_COMMON_BASE_STATUS_PARTS_H_
#define TESSERA_COMMON_BASE_STATUS_PARTS_H_

#include <string>
#include <vector>

#include "common/base/status.h"

namespace tessera {

// What PartsOf gives back for the same `kind`. An OK status stays as it is.
void SetParts(Status& error, const std::string& kind, const std::vector<std::string>& parts);
// None if none were set.
std::vector<std::string> PartsOf(const Status& status, const std::string& kind);

}  // namespace tessera

#endif  // TESSERA_COMMON_BASE_STATUS_PARTS_H_
