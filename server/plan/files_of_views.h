// Which files of a scene its views are read from.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/job/survey.h"
#include "server/plan/planned_task.h"

namespace tessera {

// Where the views' images and likelihoods are in the scene's list of files.
// NOT_FOUND with the path of one that is missing.
StatusOr<std::vector<std::vector<PlannedTask::ViewFile>>> FilesOfViews(const Survey& survey,
                                                                       const std::vector<std::string>& files);

}  // namespace tessera
