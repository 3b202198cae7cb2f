// Writes report.html beside the files that a job published.
#pragma once

#include <string>

#include "common/base/status.h"
#include "common/base/task_control.h"

namespace tessera {

namespace v1 {
class Job;
}  // namespace v1

// Name of the file, which no job publishes.
inline constexpr char kReportPageFile[] = "report.html";

// Writes `out`/report.html from mesh.ply, report.json and job.json in `out`, which FetchArtifacts wrote, and replaces
// an earlier one. The start mesh is shown if the folder of the job's scene can be read here. A mesh that cannot be
// drawn gives a page without pictures. Returns the path; empty if the job has no report.json, such as a plan. An error
// leaves no file. CANCELLED by `control`. `program_version`: of this program, for the page.
StatusOr<std::string> WriteReportPage(const v1::Job& job, const std::string& out, const std::string& program_version,
                                      const TaskControl& control);

}  // namespace tessera
