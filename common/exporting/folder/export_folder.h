// Exports the folder of a result in this process.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_format.h"

namespace tessera {

struct ExportRequest {
  std::string result;  // folder with mesh.ply and report.json
  std::string scene;   // its folder, for photographs, the start mesh and results of earlier versions; empty: none
  std::string start;   // start mesh, a file in the scene's coordinates; empty: that of `scene`
  ExportOptions options;
  std::string out;  // new or empty folder
};

// What was written.
struct ExportedFormat {
  std::string name;
  int64_t files = 0, bytes = 0;
};

// Writes the files of each format to OUT/FORMAT, and OUT/export.json: formats, options, reference system, per sheet its
// name, box (in that system), faces and whether it has faces of tiles whose refinement failed ("set_aside"), all files
// with SHA-256, warnings, and what was left out. The same result gives the same bytes, whatever the number of threads.
// A file appears whole or not at all, export.json last (ExportStaging).
//
// INVALID_ARGUMENT before work, with all faults, for what CheckExport refuses, and if a format needs what is not there:
// photographs, the start mesh, changes.geojson. RESOURCE_EXHAUSTED if the disk has too little space, ALREADY_EXISTS if
// `out` has files, errors of the formats, CANCELLED. Sheets are worked on in parallel as cores and memory allow.
StatusOr<std::vector<ExportedFormat>> ExportFolder(const ExportRequest& request, Warnings* warnings,
                                                   const TaskControl& control,
                                                   std::span<const ExportFormat> formats = ExportFormats());

}  // namespace tessera
