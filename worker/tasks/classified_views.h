// What tells likelihoods that a job makes itself from others, before they are made.
#ifndef TESSERA_WORKER_TASKS_CLASSIFIED_VIEWS_H_
#define TESSERA_WORKER_TASKS_CLASSIFIED_VIEWS_H_

#include <set>
#include <string>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "worker/tasks/task.h"

namespace tessera {

// Survey::classifier of a job: by the content of its trained classifier, which is read and checked. A warning if that
// learnt at another resolution than the survey's.
StatusOr<std::string> ClassifierContent(const TaskRequest& request, const IngestParameters& parameters, double gsd_m,
                                        Warnings* warnings);

// likelihood_content of the views, by the classifier and their photographs' colours, which are read; those whose
// image_path is in `known` keep theirs. Errors of reading, one a line, or CANCELLED.
Status FillClassifiedContents(const Survey& survey, const std::set<std::string>& known, const TaskControl& control,
                              SceneDescription* scene);

}  // namespace tessera

#endif  // TESSERA_WORKER_TASKS_CLASSIFIED_VIEWS_H_
