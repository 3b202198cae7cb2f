// The plan of an update for people: as a table and as a map.
#ifndef TESSERA_SERVER_DISPLAY_UPDATE_TEXT_H_
#define TESSERA_SERVER_DISPLAY_UPDATE_TEXT_H_

#include <string>

#include "common/base/status.h"
#include "server/display/plan_text.h"

namespace tessera {

// `json`: kUpdateFile, as a job publishes it; DATA_LOSS if it is not.

// A line a tile that is redone, with the reasons, and the totals.
StatusOr<std::string> UpdateTable(const std::string& json, const PlanTerms& terms);

// One line for a job's summary.
StatusOr<std::string> UpdateSummary(const std::string& json);

// SVG, a unit a metre of the ground plane, y up: tiles that are redone in red, others pale; new cameras as dots, those
// of the base as rings; why a tile is redone is its tooltip.
StatusOr<std::string> UpdateMap(const std::string& json);

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPLAY_UPDATE_TEXT_H_
