// The format ortho with colours from the photographs.
#pragma once

#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/exporting/export_format.h"

namespace tessera {

// WriteOrthoSheetWith with the colours of ColorPoints: the sheet's faces and its neighbours' may hide a point.
StatusOr<std::vector<std::string>> WriteOrthoSheet(const SheetInput& input, const std::string& folder,
                                                   const TaskControl& control);

}  // namespace tessera
