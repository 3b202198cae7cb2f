// Rollback: restores tiles of a job from an earlier job.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/survey.h"
#include "server/plan/planned_task.h"
#include "server/plan/update_base.h"

namespace tessera {

// The tiles of `named` (all if empty) whose state differs between the first and the last job of `chain`, ascending.
// `chain`: a job, its base job, the base job of that, ..., down to the job to restore from. `survey`: of the first job.
//
// Tiles have equal bytes at shared vertices, and a job moves a shared vertex only if it refines all tiles that contain
// it. So tiles that share vertices and were refined by the same job of the chain must be restored together.
// INVALID_ARGUMENT if such a tile is missing in `named` (the message has the command with all of them), if a tile does
// not exist, if none differs, or if the jobs have different meshes.
StatusOr<std::vector<int>> TilesToRollBack(const std::vector<UpdateBase>& chain, const Survey& survey,
                                           const std::vector<int>& named);

// The task that passes on results of `base`: `first`, the states of its tiles, its outdated faces and class borders.
PlannedTask BaseTask(const UpdateBase& base, std::vector<NamedDigest> first);

// All tasks of a rollback. `base`: the base job, with the states of the restored tiles replaced by those of the earlier
// job.
StatusOr<std::vector<PlannedTask>> PlanRollback(const UpdateBase& base);

}  // namespace tessera
