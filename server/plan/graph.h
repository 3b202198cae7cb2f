// Plans the tasks of a job in three phases. Phase 1 makes the survey. Phase 2 is planned from the survey and cuts the
// tiles. Phase 3 is planned from the cuts' results (which tiles read each other) and contains the remaining tasks. In a
// job that splits faces twice (JobPart) it ends with the task that splits them; phases 2 and 3 then follow again, for
// the fine part.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/task_parameters.h"
#include "common/storage/hash.h"
#include "server/plan/fine_part.h"
#include "server/plan/planned_task.h"
#include "server/plan/stages.h"
#include "server/plan/update_base.h"
#include "server/settings/job_settings.h"

namespace tessera {

// Each function returns the tasks of a phase, to be appended to the job's list. `scene_files`: all files of the scene,
// relative, sorted; `survey`: content of kSurveyFile. Deterministic; thread-safe.

// Phase 1: tasks that inspect the images, if there are many, and the task that makes the survey.
// `size_bytes`: of the files, for the predicted times; none: 1 MB each.
StatusOr<std::vector<PlannedTask>> PlanIngest(const JobSettings& settings, const std::vector<std::string>& scene_files,
                                              const std::vector<int64_t>& size_bytes = {});

// Phase 1 of an update: a given task with the outputs of its base, tasks that inspect the new images, if there are
// many, and the task that updates the survey. `scene_files`: sorted by name. A rollback and an export have no further
// phases (PlanRollback, PlanExportOnly).
StatusOr<std::vector<PlannedTask>> PlanUpdate(const JobSettings& settings, const std::vector<NamedDigest>& scene_files,
                                              const UpdateBase& base);

// Phase 2: one cut per tile, in order; for an untiled job all remaining tasks of its part, publish last, then exports.
// For an update (`base` not null; it has no parts): a given task with its plan, and the cuts of the redone tiles, or
// publish if there are none.
StatusOr<std::vector<PlannedTask>> PlanTiles(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files,
                                             const UpdateBase* base = nullptr, const FinePart* fine = nullptr);

// Phase 3 of a tiled job or an update, publish last, then exports. `reads`: kReadsFile of each tile that was cut, in
// order. `quarantined`: tiles that keep their last repaired state before the failed task. Their tasks up to that state
// do not change. FAILED_PRECONDITION if one of them has no state to keep.
StatusOr<std::vector<PlannedTask>> PlanSteps(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files,
                                             const std::vector<TileReads>& reads, const UpdateBase* base = nullptr,
                                             const std::vector<FailedTile>& quarantined = {},
                                             const FinePart* fine = nullptr);

}  // namespace tessera
