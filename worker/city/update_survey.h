// An earlier job's survey, taken on to more images, fewer, or others.
#ifndef TESSERA_WORKER_CITY_UPDATE_SURVEY_H_
#define TESSERA_WORKER_CITY_UPDATE_SURVEY_H_

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/job/survey.h"
#include "common/job/task_parameters.h"
#include "common/scene/scene.h"
#include "worker/city/cell_views.h"
#include "worker/city/city_file.h"
#include "worker/photo/pairs.h"

namespace tessera {

// Of the survey that an update goes on with, what became of its views.
struct ViewChanges {
  std::vector<uint8_t> changed;  // a flag a view: new, withdrawn, or its camera moved
  int64_t added = 0, withdrawn = 0, moved = 0, replaced = 0, snapped = 0;
};

// Poses are those of the base where the image would move by less everywhere in it.
inline constexpr double kSnap_px = 0.1;

// Takes the views of `scene` (base's frame, contents known) into `survey`, which is the base's: a view with the content
// of one of the base's is that one, under its number; others follow, by name. `whole`: what the scene lacks is
// withdrawn, and a view with the name of one of the base's and another content takes its place; else the scene adds to
// the base's. `carried`: under which paths the job has the base's files. INVALID_ARGUMENT for a flight to withdraw that
// there is not, with those that there are, and for classes that are not the base's.
StatusOr<ViewChanges> TakeViews(const SceneDescription& scene, bool whole, const UpdateParameters& parameters,
                                const std::map<std::string, std::string>& carried, Survey* survey);

// Chooses views anew for the cells of which the mesh is another (survey->revision), that a changed view may show or
// that had chosen one, and partners for the changed views and those that lost one. What a cell with the base's mesh
// chose stays if no changed view comes or goes. Occlusion is asked of all that may hide something of these cells.
// `all_epochs` false: where the views of the newest flight see as much of a cell (shares of its samples that two views
// see) as all views do, nearly, the others are left out.
Status ChooseAnew(const CityReader& city, const ViewChanges& changes, bool all_epochs, const CellViewOptions& options,
                  const PairOptions& pairs, const TaskControl& control, Survey* survey);

}  // namespace tessera

#endif  // TESSERA_WORKER_CITY_UPDATE_SURVEY_H_
