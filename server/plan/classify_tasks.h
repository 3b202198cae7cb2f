// The tasks of a job that makes its likelihoods itself.
#ifndef TESSERA_SERVER_PLAN_CLASSIFY_TASKS_H_
#define TESSERA_SERVER_PLAN_CLASSIFY_TASKS_H_

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
  std::set<int32_t> views;   // whose likelihoods are made
  int classifier_file = -1;  // among the scene's files; -1: by the default rule
  TaskId city_from;
  size_t first_task = 0;  // place of the first of these tasks in the job's list
  bool borders = true;    // else they are known already
};

// A task a view, in the order of the views, and last, if asked for, one that sums up what is known of their borders.
// The same for the same view, whatever else the job does or its files are called.
std::vector<PlannedTask> PlanClassify(const ClassifyWork& work);

}  // namespace tessera

#endif  // TESSERA_SERVER_PLAN_CLASSIFY_TASKS_H_
