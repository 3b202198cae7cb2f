// Exports the result of a job of a coordinator: submits the export as a job, and fetches its files.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "server/client/connection.h"
#include "server/settings/job_settings.h"

namespace tessera {

// Submits the export of the result of `job`; returns the name of the new job. Errors of the call.
StatusOr<std::string> SubmitExport(Connection& connection, const std::string& job, const ExportSettings& settings);

// Downloads the exported files of a job that has ended to `out`, a folder a format, and returns their paths. As
// FetchArtifacts; FAILED_PRECONDITION if the job has none.
StatusOr<std::vector<std::string>> FetchExports(Connection& connection, const std::string& job, const std::string& out,
                                                const TaskControl& control);

}  // namespace tessera
