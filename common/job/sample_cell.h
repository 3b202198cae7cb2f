// Selection of the sample cell of a tile: a cell of a neighbouring tile of which the tile also measures a few faces, so
// that the results of both tiles can be compared.
#pragma once

#include "common/job/ground.h"
#include "common/job/survey.h"

namespace tessera {

// Returns the better of `best` (may be null) and `cell` as sample cell of the tile with this core. Folding it over all
// cells of the survey, in any order, gives the first cell (by y, then x) that shares a side with the core and has
// views; null if there is none. The planner uses its views, and the cut task adds its faces.
inline const SurveyCell* BetterSampleCell(const SurveyCell* best, const SurveyCell& cell, const CellRect& core) {
  if (cell.views.empty() || core.Contains({cell.x, cell.y})) return best;
  const bool beside = core.Contains({cell.x - 1, cell.y}) || core.Contains({cell.x + 1, cell.y}) ||
                      core.Contains({cell.x, cell.y - 1}) || core.Contains({cell.x, cell.y + 1});
  if (!beside) return best;
  const bool before = best == nullptr || (cell.y != best->y ? cell.y < best->y : cell.x < best->x);
  return before ? &cell : best;
}

}  // namespace tessera
