// The planner's entry points: from a job to its tasks, in phases. Phase 1 makes the survey; phase 2 is planned from the
// survey and cuts every tile; phase 3 is planned from which tiles read each other and holds all remaining tasks.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/task_parameters.h"
#include "common/storage/hash.h"
#include "server/plan/planned_task.h"
#include "server/plan/stages.h"
#include "server/plan/update_base.h"
#include "server/settings/job_settings.h"

namespace tessera {

// Each gives the tasks of a phase, to be appended to those before. `scene_files`: every file of the scene, relative,
// sorted; `survey`: content of ingest's kSurveyFile. Deterministic.

// Phase 1: the first task of a job.
StatusOr<PlannedTask> PlanIngest(const JobSettings& settings, const std::vector<std::string>& scene_files);

// The same of an update: what it takes from its base (given), and the task that takes the survey on. `scene_files`:
// sorted by name. Of one that goes back to an earlier job all tasks (PlanRollback).
StatusOr<std::vector<PlannedTask>> PlanUpdate(const JobSettings& settings, const std::vector<NamedDigest>& scene_files,
                                              const UpdateBase& base);

// Phase 2: the cut of every tile, in order; of a single tile all that is left, publish at the end. Of an update
// (`base` not null): its plan (given), and the cuts of the tiles that are redone; publish, if there are none.
StatusOr<std::vector<PlannedTask>> PlanTiles(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files,
                                             const UpdateBase* base = nullptr);

// Phase 3, of more than one tile or an update, publish at the end. `reads`: of each tile that was cut, in order, as its
// cut wrote it. `quarantined`: tiles that stay as they were with the last state without folds before the task that
// failed: what they did until then is planned as without this. FAILED_PRECONDITION if one has nothing that could stay.
StatusOr<std::vector<PlannedTask>> PlanSteps(const JobSettings& settings, const std::string& survey,
                                             const std::vector<std::string>& scene_files,
                                             const std::vector<TileReads>& reads, const UpdateBase* base = nullptr,
                                             const std::vector<FailedTile>& quarantined = {});

}  // namespace tessera
