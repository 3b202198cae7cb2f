// The plan of an update as a table and as a map.
#pragma once

#include <string>

#include "common/base/status.h"
#include "server/display/plan_text.h"

namespace tessera {

// `json` is the content of kUpdateFile, as a job publishes it; DATA_LOSS if it is malformed.

// One line per refined tile, with the reasons, and the totals.
StatusOr<std::string> UpdateTable(const std::string& json, const PlanTerms& terms);

// One line for a job's summary.
StatusOr<std::string> UpdateSummary(const std::string& json);

// SVG, one unit per metre of the ground plane, y up: refined tiles in red, others pale; new cameras as dots, cameras of
// the base job as rings. The tooltip of a refined tile shows its cost.
StatusOr<std::string> UpdateMap(const std::string& json);

}  // namespace tessera
