// Tasks of a job that computes likelihoods itself.
#pragma once

#include <cstddef>
#include <cstdint>
#include <set>
#include <vector>

#include "common/job/survey.h"
#include "server/plan/planned_task.h"

namespace tessera {

struct ClassifyWork {
  const Survey& survey;
  const std::vector<std::vector<PlannedTask::ViewFile>>& files_of_view;
  std::set<int32_t> views;   // views to classify
  int classifier_file = -1;  // index in the scene's files; -1: the default rule
  TaskId city_from;
  size_t first_task = 0;  // index of the first of these tasks in the job's list
  bool borders = true;    // add the task that summarizes class borders
};

// One task per view, in order, and, if `borders`, a last task that summarizes their class borders. The task of a view
// depends only on that view, not on the rest of the job or on file names.
std::vector<PlannedTask> PlanClassify(const ClassifyWork& work);

}  // namespace tessera
