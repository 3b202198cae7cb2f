// Going back to what an earlier job left of some tiles.
#ifndef TESSERA_SERVER_PLAN_ROLLBACK_H_
#define TESSERA_SERVER_PLAN_ROLLBACK_H_

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/survey.h"
#include "server/plan/planned_task.h"
#include "server/plan/update_base.h"

namespace tessera {

// The tiles of `named` (all, if it is empty) of which the first job of `chain` has another state than the last,
// ascending. `chain`: a job, its base, the base's base, ..., to the job that it is to go back to; `survey`: of the
// first.
//
// Tiles have the same bytes where they share vertices, and a job moves such a vertex only if it makes all tiles anew
// that have it. So tiles that share vertices and were made anew by the same job of the chain go back together.
// INVALID_ARGUMENT if others than those named have to go along, with the command that names all; if there is no such
// tile, or none that differs; if the jobs have other meshes.
StatusOr<std::vector<int>> TilesToRollBack(const std::vector<UpdateBase>& chain, const Survey& survey,
                                           const std::vector<int>& named);

// All tasks of a job that goes back. `base`: the job that it goes on from, with the states of the tiles that go back
// taken from the earlier one.
StatusOr<std::vector<PlannedTask>> PlanRollback(const UpdateBase& base);

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_ROLLBACK_H_
