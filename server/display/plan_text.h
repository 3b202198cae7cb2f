// A plan as a table, as JSON and as a map.
#pragma once

#include <optional>
#include <string>

#include "common/job/survey.h"
#include "server/tiling/quote.h"

namespace tessera {

struct PlanTerms {
  int workers = 1, threads_per_worker = 1;
  std::optional<double> price_per_core_hour;  // in any currency
};

// One line per tile, and the totals with their interval.
std::string PlanTable(const Quote& quote, const PlanTerms& terms);

// {"tessera_plan": 1, ...}; units are seconds, bytes and metres.
std::string PlanJson(const Quote& quote, const PlanTerms& terms);

// SVG, one unit per metre of the ground plane, y up: tiles coloured by predicted core-seconds, cameras as dots. The
// tooltip of a tile shows its cost.
std::string PlanMap(const Quote& quote, const Survey& survey);

}  // namespace tessera
