// The tasks in pipeline order, one file each. A task reads its inputs from request.input_dir and writes its outputs
// to request.output_dir; errors and guarantees as RunTask.
#pragma once

#include <string>

#include "common/base/elapsed.h"
#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/check/inspection.h"
#include "common/job/task_parameters.h"
#include "worker/tasks/task.h"

namespace tessera {

// Some images of a scene, with masks and likelihoods → what they hold, and faults of the files.
StatusOr<TaskOutcome> RunInspect(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// The inspections among the inputs of ingest or update, and how they fetch pixel files.
StatusOr<InspectedFiles> ReadInspections(const TaskRequest& request, const IngestParameters& parameters);

// Scene and inspections → the repaired and split mesh of the city, and the survey: GSD, cells and their views, pairs.
StatusOr<TaskOutcome> RunIngest(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Survey and city of the base job, a scene and inspections → the updated survey, and the updated city if the mesh
// changed.
StatusOr<TaskOutcome> RunUpdate(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City, classifier and an image → its likelihoods, and statistics of their borders against the image's edges.
StatusOr<TaskOutcome> RunClassify(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// The statistics of all images → how far the likelihoods' borders can be trusted.
StatusOr<TaskOutcome> RunBorders(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City and survey → a tile's package, and which other tiles it reads.
StatusOr<TaskOutcome> RunCut(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package and images → the pixels that show the tile.
StatusOr<TaskOutcome> RunCrop(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package, pixels and, in the fine part, the start of the job's only tile → its state after all steps of the part.
StatusOr<TaskOutcome> RunRefine(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package, pixels and states of the visible tiles → sums of the data term per face of the core, for one step.
StatusOr<TaskOutcome> RunMeasure(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package, sums and states within the dependency radius → the core's state after the step.
StatusOr<TaskOutcome> RunSolve(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// Package and states within the dependency radius → the core's state after the repair.
StatusOr<TaskOutcome> RunRepair(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City, survey and the states after the coarse levels → the city whose large faces are split again, its survey, and the
// moved surface.
StatusOr<TaskOutcome> RunSplit(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City and survey → the core's start as its state, for a tile whose refinement failed. With the moved surface → the
// core's state after the coarse levels.
StatusOr<TaskOutcome> RunStart(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City, survey, states of the base job and new images → change raster of a block of ground.
StatusOr<TaskOutcome> RunCompare(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// All change rasters and the last states → changes.json, changes.geojson, changes.png.
StatusOr<TaskOutcome> RunChanges(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// City, survey and the last states → mesh.ply in the scene's frame, and report.json.
StatusOr<TaskOutcome> RunPublish(const TaskRequest& request, const TaskControl& control, const Clock& clock);

// One stage of an export of the published mesh (common/exporting/export_parameters.h).
StatusOr<TaskOutcome> RunExport(const TaskRequest& request, const TaskControl& control, const Clock& clock);

inline std::string InputPath(const TaskRequest& request, const std::string& name) {
  return request.input_dir + "/" + name;
}
inline std::string OutputPath(const TaskRequest& request, const std::string& name) {
  return request.output_dir + "/" + name;
}

}  // namespace tessera
