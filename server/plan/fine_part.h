// The fine part of a job that splits faces twice (JobPart): the task before it, and its tiles.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "server/plan/graph_tile.h"
#include "server/plan/planned_task.h"
#include "server/settings/job_settings.h"

namespace tessera {

// What the fine part is planned from.
struct FinePart {
  std::string survey;              // content of the kSurveyFile of the task that split the faces
  TaskId split;                    // this task
  int first_task = 0;              // index of the first of the part's tasks
  std::vector<int> left_out = {};  // tiles that were quarantined before, ascending: they keep their state
  std::map<int, TaskId> crops = {};  // by tile: the task with its crops
};

// The task that splits the faces: the last of the coarse part. `survey`: with which the job began; `tiles`: with their
// last states; `planned`: the job's tasks before it; `city_from`: the task with city and survey.
StatusOr<PlannedTask> PlanSplit(const JobSettings& settings, const Survey& survey, const std::vector<GraphTile>& tiles,
                                const std::vector<PlannedTask>& planned, TaskId city_from);

// Sets CutParameters::fine_iterations and `max_step_px`.
void SetFineIterations(const JobSettings& settings, CutParameters* cut);

// The survey after the split. INVALID_ARGUMENT unless it has the views and the cell size of `before`.
StatusOr<Survey> SurveyOf(const FinePart& fine, const Survey& before);
// The tiles of the coarse part, grown to contain all cells of `survey`.
std::vector<GraphTile> TilesOf(const FinePart& fine, const std::vector<GraphTile>& coarse, const Survey& survey);

}  // namespace tessera
