// Content keys of likelihoods that a job computes itself, before they exist.
#pragma once

#include <set>
#include <string>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/check/inspection.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "worker/tasks/task.h"

namespace tessera {

// Sets Survey::classifier of a job to the content of its trained classifier, which is read and checked. Warns if the
// classifier was trained at another resolution than the survey's.
StatusOr<std::string> ClassifierContent(const TaskRequest& request, const IngestParameters& parameters, double gsd_m,
                                        Warnings* warnings);

// Sets likelihood_content of the views from the classifier and the colours of their images, which are read unless they
// are inspected. Views whose image_path is in `known` keep theirs. Read errors, one per line, CANCELLED, or errors of
// fetching.
Status FillClassifiedContents(const Survey& survey, const std::set<std::string>& known, const InspectedFiles& files,
                              const TaskControl& control, SceneDescription* scene);

}  // namespace tessera
