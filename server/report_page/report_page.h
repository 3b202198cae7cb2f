// report.html: what a job did and what its result looks like, as one page for its customer.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/report_page/report_pictures.h"

namespace tessera {

// Everything may be missing; the page is then shorter. Texts may hold any bytes.
struct ReportPageInputs {
  std::string report_json;     // content of report.json
  std::string_view job_json;   // content of job.json
  std::string update_summary;  // of an update, in words (UpdateSummary)
  std::optional<ReportPictures> pictures;
  std::string no_pictures;                                  // why there are none
  std::string scene_name;                                   // replaces that of report.json where it has none
  std::string created, finished;                            // times of the job, as text
  std::string mesh_sha256;                                  // of mesh.ply
  std::string program_version;                              // of the program that writes the page
  std::string command;                                      // that repeats the job
  std::vector<std::pair<std::string, std::string>> source;  // where the scene comes from: name and value
};

// The page: one HTML document without scripts and references. All text is escaped. The same inputs give the same bytes.
std::string MakeReportPage(const ReportPageInputs& inputs);

}  // namespace tessera
