// The cell of a neighbour of which a tile measures a few faces too, so that both can be compared.
#ifndef TESSERA_COMMON_JOB_SAMPLE_CELL_H_
#define TESSERA_COMMON_JOB_SAMPLE_CELL_H_

#include "common/job/ground.h"
#include "common/job/survey.h"

namespace tessera {

// For the tile with this core: called for each cell of the survey, in any order, with what it gave for the one before
// (null at first), it ends with the first by y, then x, of those that have a side in common with the core and views
// that look at them; null if there is none. The planner counts on its views, cut takes it.
inline const SurveyCell* BetterSample(const SurveyCell* best, const SurveyCell& cell, const CellRect& core) {
  if (cell.views.empty() || core.Contains({cell.x, cell.y})) return best;
  const bool beside = core.Contains({cell.x - 1, cell.y}) || core.Contains({cell.x + 1, cell.y}) ||
                      core.Contains({cell.x, cell.y - 1}) || core.Contains({cell.x, cell.y + 1});
  if (!beside) return best;
  const bool before = best == nullptr || (cell.y != best->y ? cell.y < best->y : cell.x < best->x);
  return before ? &cell : best;
}

}  // namespace tessera

#endif  // TESSERA_COMMON_JOB_SAMPLE_CELL_H_
