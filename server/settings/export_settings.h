// Converts the export settings of a job to the options of the exporting functions.
#pragma once

#include "common/base/status.h"
#include "common/exporting/export_format.h"
#include "common/exporting/export_scene.h"
#include "server/settings/job_settings.h"

namespace tessera {

// The options, with each format once. INVALID_ARGUMENT lists every fault that shows without the scene: no or unknown
// formats, an unknown colour, a GSD that is not positive.
StatusOr<ExportOptions> ExportOptionsOf(const ExportSettings& settings);

// Refuses before work what cannot succeed (CheckExport). OK if the job exports nothing.
Status CheckExports(const JobSettings& settings, const ExportScene& scene);
// The same for the scene of a survey. Also INVALID_ARGUMENT if the survey's source is damaged, or if the system does
// not cover a sheet of the start mesh.
Status CheckExports(const JobSettings& settings, const Survey& survey);

// What the user should know of the exports before work (ExportWarnings). Empty if the job exports nothing.
Warnings WarningsOfExports(const JobSettings& settings, const ExportScene& scene);

}  // namespace tessera
