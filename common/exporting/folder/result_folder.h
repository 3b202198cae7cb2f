// The folder of a result, as `tessera run` and `tessera fetch` write it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/exporting/export_scene.h"
#include "common/exporting/sheet.h"
#include "common/exporting/survey_sheets.h"
#include "common/job/ground.h"
#include "common/scene/scene.h"

namespace tessera {

struct ResultFolder {
  std::string mesh_path;                      // in the scene's coordinates
  std::string changes_path;                   // changes.geojson; empty: there is none
  ExportScene scene;                          // of report.json, else of the scene's folder
  std::optional<SceneDescription> described;  // the scene, if its folder was given
  ViewNamesOfSheets views_of_sheets;          // that the job chose; empty: report.json does not have them
  // Cores of the tiles whose refinement failed. `is_set_aside`: some failed, and the folder does not say where they
  // are.
  std::vector<CellRect> set_aside_cores;
  bool is_set_aside = false;
};

// Reads report.json and the index of tiles, not the mesh. `scene_path`: the scene's folder, or empty.
// `needs_photographs`: their files must exist. INVALID_ARGUMENT if `path` is no result, if report.json has no frame and
// there is no scene, if the scene is not that of the result, and errors of LoadScene, whose warnings the job has given.
StatusOr<ResultFolder> OpenResultFolder(const std::string& path, const std::string& scene_path, bool needs_photographs);

// Whether the sheet may have faces of tiles whose refinement failed.
bool IsSetAside(const ResultFolder& result, const SheetId& sheet);

}  // namespace tessera
