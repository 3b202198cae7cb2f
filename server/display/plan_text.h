// A plan for people and programs: as a table, as JSON, as a map.
#ifndef TESSERA_SERVER_DISPLAY_PLAN_TEXT_H_
#define TESSERA_SERVER_DISPLAY_PLAN_TEXT_H_

#include <optional>
#include <string>

#include "common/job/survey.h"
#include "server/plan/quote.h"

namespace tessera {

struct PlanTerms {
  int workers = 1, threads_per_worker = 1;
  std::optional<double> price_per_core_hour;  // in whatever currency
};

// A line a tile and the totals with their interval.
std::string PlanTable(const Quote& quote, const PlanTerms& terms);

// {"tessera_plan": 1, ...}; seconds, bytes and metres.
std::string PlanJson(const Quote& quote, const PlanTerms& terms);

// SVG, a unit a metre of the ground plane, y up: tiles coloured by their predicted core-seconds,
// where the cameras stand as dots; what a tile takes is its tooltip.
std::string PlanMap(const Quote& quote, const Survey& survey);

}  // namespace tessera

#endif  // TESSERA_SERVER_DISPLAY_PLAN_TEXT_H_
