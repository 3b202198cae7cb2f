// Tasks that export the result of a job.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "common/exporting/export_format.h"
#include "common/job/survey.h"
#include "server/plan/planned_task.h"
#include "server/plan/update_base.h"

namespace tessera {

struct ExportWork {
  const ExportOptions& options;       // that passed CheckExport
  std::vector<ExportFormat> formats;  // FormatsOf(options); tests pass rows of their own
  const Survey& survey;
  const std::vector<std::vector<PlannedTask::ViewFile>>& files_of_view;
  TaskId city_from, survey_from, mesh_from;  // tasks with kCityFile, kPlainSurveyFile and kMeshFile
  size_t first_task = 0;                     // index of the first of these tasks in the job's list
  std::vector<CellRect> quarantined = {};    // cores of tiles whose refinement failed
  std::optional<PlannedInput> changes = {};  // kChangesGeoJsonFile of an update with changes
};

// The tasks of all stages (common/exporting/export_parameters.h). No task but split reads the survey or the mesh, so
// that a sheet that an update does not change keeps its key, and its files their bytes. INVALID_ARGUMENT if the
// survey's source is damaged.
StatusOr<std::vector<PlannedTask>> PlanExports(const ExportWork& work);

// All tasks of a job that exports the result of its base: a given task with that result, and the exports.
// `scene_files`: sorted. INVALID_ARGUMENT also as CheckExport.
StatusOr<std::vector<PlannedTask>> PlanExportOnly(const JobSettings& settings,
                                                  const std::vector<std::string>& scene_files, const UpdateBase& base);

}  // namespace tessera
