// The stages of an export that know a format (common/exporting/export_parameters.h).
#pragma once

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_format.h"
#include "common/exporting/export_parameters.h"
#include "worker/tasks/task.h"

namespace tessera {

// Runs ExportFormat::write_sheet on the sheet of the parameters. Delivers one file as it is, several as an archive
// (SheetArchiveName); writes nothing but an empty part for a sheet without faces. Errors as RunTask.
StatusOr<TaskOutcome> ExportSheet(const TaskRequest& request, const ExportParameters& parameters,
                                  const ExportFormat& format, const TaskControl& control);

// Runs ExportFormat::join on all sheets with faces. Errors as RunTask.
StatusOr<TaskOutcome> JoinExport(const TaskRequest& request, const ExportParameters& parameters,
                                 const ExportFormat& format, const TaskControl& control);

// Reads the input of a stage that reads one sheet: the sheet, and what the parameters list. `scene` and `options` must
// outlive it.
StatusOr<SheetInput> ReadSheetInput(const TaskRequest& request, const ExportParameters& parameters,
                                    const ExportScene& scene, const ExportOptions& options);

// kExportSceneFile among the inputs.
StatusOr<ExportScene> ReadExportScene(const TaskRequest& request);

// Splits the result, the start and their views into sheets: the stage split. Errors as RunTask.
StatusOr<TaskOutcome> SplitResult(const TaskRequest& request, const ExportParameters& parameters,
                                  const TaskControl& control);

}  // namespace tessera
