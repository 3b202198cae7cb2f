// Files of a scene that contain the pixels of its views.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/survey.h"
#include "server/plan/planned_task.h"

namespace tessera {

// Per view: its image and likelihoods, as indices in the scene's list of files. NOT_FOUND with the path of a missing
// one.
StatusOr<std::vector<std::vector<PlannedTask::ViewFile>>> FilesOfViews(const Survey& survey,
                                                                       const std::vector<std::string>& files);

}  // namespace tessera
