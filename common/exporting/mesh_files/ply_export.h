// The export format `ply`: one file with the whole mesh.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_format.h"

namespace tessera {

// Writes mesh.ply: binary, with double positions in coordinates of options.crs (ExportMap). Vertices have red, green,
// blue by options.color, and float scalar_label: the class of most area around them. Faces have int label, the colour
// of their class, and confidence if all sheets have it. Vertices on borders of sheets are welded. Reads each sheet
// three times, one at a time.
StatusOr<std::vector<std::string>> JoinPly(const JoinInput& input, const std::string& folder,
                                           const TaskControl& control);

}  // namespace tessera
