// Updates an earlier job's survey to more, fewer or other images.
#pragma once

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

// Changes of the views of an updated survey.
struct ViewChanges {
  std::vector<uint8_t> changed;  // one flag per view: new, withdrawn, or its camera moved
  int64_t added = 0, withdrawn = 0, moved = 0, replaced = 0, snapped = 0;
};

// A view keeps the base job's pose if the pose would move its image by less than this everywhere.
inline constexpr double kSnap_px = 0.1;

// Merges the views of `scene` (frame of the base job, content hashes set) into `survey`, the base job's. A view with
// the content of one of the base's views keeps that view's index; new views are appended in order of their names.
// `whole`: views missing from the scene are withdrawn, and a view with a known name but other content replaces that
// view; otherwise the scene adds to the base's views. `carried`: paths of the base's files in this job.
// INVALID_ARGUMENT if a flight to withdraw does not exist (lists those that do), or if the classes differ from the
// base's.
StatusOr<ViewChanges> UpdateViews(const SceneDescription& scene, bool whole, const UpdateParameters& parameters,
                                  const std::map<std::string, std::string>& carried, Survey* survey);

// Selects views again for the cells whose mesh changed (survey->revision), that a changed view may show or that used
// one, and selects partners for the changed views and for views that lost a partner. An unchanged cell keeps its
// views if no changed view is added or removed. Occlusion is tested against all blocks that may hide these cells.
// `all_epochs` false: if the views of the newest flight cover nearly as much of a cell (share of its samples that two
// views see) as all views, older views are not used.
Status UpdateViewSelection(const CityReader& city, const ViewChanges& changes, bool all_epochs,
                           const CellViewOptions& options, const PairOptions& pairs, const TaskControl& control,
                           Survey* survey);

}  // namespace tessera
